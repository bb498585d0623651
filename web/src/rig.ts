// The instrument itself: axes, camera, disk, calibration.

import { fact } from "./dom.ts";
import { bytes, duration, grouped } from "./format.ts";
import type { AxisStatus, CameraStatus, Status } from "./status.ts";

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
    rows.push(["Calibration", status.calibration === null ? "none recorded" : "recorded"]);
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

function frames(camera: CameraStatus): string {
  const parts = [`${grouped(camera.completed_frames)} complete`];
  if (camera.failed_frames > 0) parts.push(`${grouped(camera.failed_frames)} failed`);
  if (camera.missing_packets > 0) parts.push(`${grouped(camera.missing_packets)} packets missing`);
  if (camera.resent_packets > 0) parts.push(`${grouped(camera.resent_packets)} packets sent again`);
  return parts.join(", ");
}
