// The state of the instrument: axes, camera, disk, calibration.

import { fact, setText } from "./dom.ts";
import { age, bytes, capitalised, duration, grouped, micrometres, significant } from "./format.ts";
import type {
  CalibrationStatus,
  CameraStatus,
  GateStatus,
  Light,
  NoticesStatus,
  OutputStatus,
  RotationStatus,
  Status,
  TranslationStatus,
} from "./status.ts";

export class RigView {
  readonly #list: HTMLElement;
  readonly #words: HTMLElement;
  #shown = "";

  /** `words` stand beside the heading, where the list is folded. */
  constructor(list: HTMLElement, words: HTMLElement) {
    this.#list = list;
    this.#words = words;
  }

  update(status: Status): void {
    const {
      rotation,
      translation,
      outputs,
      camera,
      camera_second: second,
      disk_free_bytes: free,
      index_trouble: behind,
    } = status.hardware;
    const rows: [string, string][] = [["Rotation", axis(rotation)]];
    if (translation) rows.push(["Translation", slide(translation)]);
    if (outputs.length > 0) rows.push(["Outputs", outputs.map(outputWords).join(", ")]);
    rows.push(["Camera", cameraWords(camera)], ["Frames", frames(camera)]);
    if (camera.light) rows.push(["Light", lightWords(camera.light)], ["Focus", focusWords(camera.light)]);
    if (second) rows.push(["Second camera", cameraWords(second)], ["Its frames", frames(second)]);
    if (free !== null) rows.push(["Disk free", bytes(free)]);
    if (behind !== null) rows.push(["Index", `! lists of runs may be incomplete: ${behind}`]);
    if (status.notices) rows.push(["Notices", noticesWords(status.notices)]);
    rows.push(["Calibration", calibrationWords(status.calibration)]);
    const gate = status.calibration?.gate;
    if (gate) rows.push(["Daily beads", gateWords(gate)]);
    rows.push(["Program up for", duration(Math.floor(status.uptime_s / 60) * 60 || Math.floor(status.uptime_s))]);
    const now = JSON.stringify(rows);
    if (now === this.#shown) return;
    this.#shown = now;
    this.#list.replaceChildren(...rows.flatMap(([term, text]) => fact(term, text)));
    setText(this.#words, toLookAt(rows));
  }
}

/** The states that somebody has to look at: `! Calibration: scale never checked with beads`. Pure. */
export function toLookAt(rows: readonly (readonly [string, string])[]): string {
  const found = rows.flatMap(([term, text]) => {
    // One of several outputs may have it.
    const [, sign] = /(?:^|, )([!✕]) /u.exec(text) ?? [];
    return sign === undefined ? [] : [`${sign} ${term}: ${text.startsWith(sign) ? text.slice(2) : text}`];
  });
  return found.length === 0 ? "✓ nothing to look at" : found.join("; ");
}

function axis(axis: RotationStatus): string {
  if (!axis.connected) return "✕ not connected";
  if (!axis.referenced) return "reference not found yet: each specimen begins with it";
  return axis.position_deg === null ? "✓ referenced" : `✓ at ${axis.position_deg.toFixed(2)}°`;
}

function slide(axis: TranslationStatus): string {
  if (!axis.connected) return "✕ not connected";
  if (!axis.referenced) return "reference not found yet";
  return axis.position_um === null ? "✓ referenced" : `✓ at ${micrometres(axis.position_um)}`;
}

/** Where notices go, and why they do not arrive. */
export function noticesWords({ receiver, trouble }: NoticesStatus): string {
  return trouble === null ? `✓ to ${receiver}` : `! ${trouble}`;
}

/** Name and state of an output, and why it could not be switched. */
export function outputWords({ name, state, trouble }: OutputStatus): string {
  return trouble === null ? `${name} ${state}` : `! ${name} ${state}: ${trouble}`;
}

/** Background level of the newest view, 0 to 255, and the saturated share of it. */
export function lightWords({ background, saturated }: Light): string {
  const level = `background ${grouped(background)} of 255`;
  return saturated < 0.0005 ? level : `${level}, ${significant(saturated * 100, 2)} % saturated`;
}

/** Useful only in comparison with other views on the same rig. Millionths are easier to compare than 0.00123. */
export function focusWords({ focus }: Light): string {
  return `${grouped(focus * 1e6)} (higher is sharper)`;
}

function cameraWords(camera: CameraStatus): string {
  if (!camera.connected) return "✕ not connected";
  return camera.identity === null ? "✓ connected" : `✓ ${camera.identity}`;
}

/** The newest calibration of the rig in one line. */
export function calibrationWords(calibration: CalibrationStatus | null): string {
  // The daily beads have their own line.
  if (calibration === null || calibration.kind === "gate") return "! scale never checked with beads";
  const { kind, bead_bias_percent: bias, age_s, max_age_s, valid } = calibration;
  const parts = [`${valid ? "✓" : "!"} by ${kind}, ${age(age_s)} old`];
  if (!valid) parts.push(`valid for ${age(max_age_s)}`);
  if (bias !== null) parts.push(`beads ${bias > 0 ? "+" : ""}${grouped(bias, 2)} %`);
  return parts.join(", ");
}

/** How far the clocks of instrument and browser may be apart, ms. */
const CLOCKS_APART_MS = 5 * 60_000;

/** The result of the newest daily beads, and whether it is still valid. */
export function gateWords({ stands, summary, verdict, words, measured }: GateStatus, now = Date.now()): string {
  if (!stands && Date.parse(measured) > now + CLOCKS_APART_MS) {
    return "! The date of these beads is in the future: check the clock of the instrument's computer.";
  }
  if (summary) {
    const isTooOld = !stands && verdict !== "failed" && verdict !== "too_few_beads";
    return isTooOld ? `! Too old: measure beads again. At that time: ${summary}` : `${stands ? "✓" : "✕"} ${summary}`;
  }
  return `${stands ? "✓" : "✕"} ${words.map((sentence) => capitalised(sentence.replace(/\.$/, ""))).join(". ")}.`;
}

/** Damaged frames and lost packets. Frames that never came are not counted here. The number of good frames is left out: it rises only after each well, which looks like a loss. */
function frames(camera: CameraStatus): string {
  const parts: string[] = [];
  if (camera.failed_frames > 0) parts.push(`${grouped(camera.failed_frames)} failed`);
  if (camera.missing_packets > 0) parts.push(`${grouped(camera.missing_packets)} packets missing`);
  if (camera.resent_packets > 0) parts.push(`${grouped(camera.resent_packets)} packets sent again`);
  return parts.length === 0 ? "✓ none damaged" : parts.join(", ");
}
