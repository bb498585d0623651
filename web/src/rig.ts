// The instrument itself: axes, camera, disk, calibration.

import { fact } from "./dom.ts";
import { age, bytes, duration, grouped } from "./format.ts";
import type { AxisStatus, CalibrationStatus, CameraStatus, Status } from "./status.ts";

export class RigView {
  readonly #list: HTMLElement;
  #shown = "";

  constructor(list: HTMLElement) {
    this.#list = list;
  }

  update(status: Status): void {
    const { rotation, translation, camera, disk_free_bytes: free } = status.hardware;
    const rows: [string, string][] = [["Rotation", axis(rotation)]];
    if (translation) rows.push(["Translation", axis(translation)]);
    rows.push(["Camera", cameraWords(camera)], ["Frames", frames(camera)]);
    if (free !== null) rows.push(["Disk free", bytes(free)]);
    rows.push(["Calibration", calibrationWords(status.calibration)]);
    rows.push(["Running for", duration(Math.floor(status.uptime_s / 60) * 60 || Math.floor(status.uptime_s))]);
    const now = JSON.stringify(rows);
    if (now === this.#shown) return;
    this.#shown = now;
    this.#list.replaceChildren(...rows.flatMap(([term, text]) => fact(term, text)));
  }
}

function axis(axis: AxisStatus): string {
  if (!axis.connected) return "✕ not connected";
  if (!axis.referenced) return "! not referenced";
  return axis.position_deg === null ? "✓ referenced" : `✓ at ${axis.position_deg.toFixed(2)}°`;
}

function cameraWords(camera: CameraStatus): string {
  if (!camera.connected) return "✕ not connected";
  return camera.identity === null ? "✓ connected" : `✓ ${camera.identity}`;
}

/** The rig's newest calibration in one line. */
export function calibrationWords(calibration: CalibrationStatus | null): string {
  if (calibration === null) return "! none kept";
  const { kind, bead_bias_percent: bias, age_s, max_age_s, valid } = calibration;
  const parts = [`${valid ? "✓" : "!"} by ${kind}, ${age(age_s)} old`];
  if (!valid) parts.push(`valid for ${age(max_age_s)}`);
  if (bias !== null) parts.push(`beads ${bias > 0 ? "+" : ""}${grouped(bias, 2)} %`);
  return parts.join(", ");
}

function frames(camera: CameraStatus): string {
  const parts = [`${grouped(camera.completed_frames)} complete`];
  if (camera.failed_frames > 0) parts.push(`${grouped(camera.failed_frames)} failed`);
  if (camera.missing_packets > 0) parts.push(`${grouped(camera.missing_packets)} packets missing`);
  if (camera.resent_packets > 0) parts.push(`${grouped(camera.resent_packets)} packets sent again`);
  return parts.join(", ");
}
