// The colours of a plate by a number. Pure.
//
//   well ── valueOf ──> number ── colourOf, within the range of the run ──> background and ink
//
// Volume, area and quality have the scale cividis, distances from a mean the scale RdBu. Both are made for readers who do not distinguish red
// and green. The ends of a distance are at 3 standard deviations. Those of the other numbers leave outliers beyond them, which are marked. A
// number that is a bound has no colour.

import { counted, grouped, significant, UM3_PER_NL } from "./format.ts";
import { countsWith } from "./reasons.ts";
import type { PlannedWell, WellStatus } from "./status.ts";
import { isBound } from "./wells.ts";

export type Colouring = "outcome" | "volume" | "area" | "z_volume" | "z_area" | "controls" | "flags" | "residual";

/** What each colouring shows, as the operator chooses it. */
export const COLOURINGS: Record<Colouring, string> = {
  outcome: "Outcome",
  volume: "Volume, nL",
  area: "Area, mm²",
  z_volume: "Volume against references, SD",
  z_area: "Area against references, SD",
  controls: "Volume against this plate's controls, SD",
  flags: "Quality: number of flags",
  residual: "Quality: residual of the outlines, px",
};

/** Colourings by a distance from a mean. The others run from the least to the most. */
const DISTANCES: readonly Colouring[] = ["z_volume", "z_area", "controls"];

const SEQUENTIAL = ["#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838"];
const DIVERGING = ["#2166ac", "#92c5de", "#f7f7f7", "#f4a582", "#b2182b"];
/** The ends of a diverging scale. */
const FAR_SD = 3;
/** Fewer controls give no standard deviation that is worth a colour. */
export const LEAST_CONTROLS = 3;

export interface Spread {
  mean: number;
  sd: number;
  n: number;
  /** The controls with a number that does not count: a bound, a doubtful one, or one that a person has left out. */
  leftOut: readonly string[];
}

/** The negative controls that have a volume. */
function measuredControls(wells: readonly WellStatus[], plan: readonly PlannedWell[]): readonly WellStatus[] {
  const controls = new Set(plan.filter((w) => w.control === "negative").map((w) => w.well));
  return wells.filter((w) => controls.has(w.well) && w.volume_um3 !== null);
}

/** The wells whose numbers statistics leave out. */
const leftOutOf = (wells: readonly WellStatus[]) => wells.filter((w) => !countsWith(w.flags)).map((w) => w.well);

/**
 * Mean and standard deviation of the volumes of the negative controls that count, as in the statistics; null if they are too few or all
 * alike.
 */
export function controlsOf(wells: readonly WellStatus[], plan: readonly PlannedWell[]): Spread | null {
  const measured = measuredControls(wells, plan);
  const volumes = measured.flatMap((w) => (countsWith(w.flags) && w.volume_um3 !== null ? [w.volume_um3] : []));
  if (volumes.length < LEAST_CONTROLS) return null;
  const mean = volumes.reduce((sum, v) => sum + v, 0) / volumes.length;
  const sd = Math.sqrt(volumes.reduce((sum, v) => sum + (v - mean) ** 2, 0) / (volumes.length - 1));
  return sd > 0 ? { mean, sd, n: volumes.length, leftOut: leftOutOf(measured) } : null;
}

/** The wells that have a colour. A bead among larvae has none: it would make their differences invisible. */
export function scaledWells(wells: readonly WellStatus[], by: Colouring): readonly WellStatus[] {
  if (by !== "volume" && by !== "area") return wells;
  const larvae = wells.filter((w) => w.specimen === "larva");
  return larvae.length > 0 ? larvae : wells;
}

/** Why no well has a colour. */
export function whyNone(wells: readonly WellStatus[], by: Colouring, plan: readonly PlannedWell[]): string {
  const measured = wells.filter((w) => w.volume_um3 !== null);
  if (measured.length === 0) return "No colours yet: no well is measured.";
  if (by === "controls") {
    const left = leftOutOf(measuredControls(wells, plan));
    const out = left.length === 0 ? "" : ` Left out: ${left.join(", ")}.`;
    return `No colours: statistics can use fewer than ${LEAST_CONTROLS} negative controls of this plate, or their volumes are all alike.${out}`;
  }
  if (by !== "z_volume" && by !== "z_area") return "No colours yet: no well has this number.";
  const places = measured.flatMap((w) => w.reference?.[by === "z_volume" ? "volume" : "area"] ?? []);
  const reasons = [...new Set(places.map(({ words }) => words.replace(/^\w+: /, "")))];
  return reasons.length > 0
    ? `No colours: ${reasons.join("; ")}.`
    : "No colours: no measured well is a larva of known age with references.";
}

/** The number that a well is coloured by; null if it has none. */
export function valueOf(well: WellStatus, by: Colouring, controls: Spread | null): number | null {
  switch (by) {
    case "outcome":
      return null;
    case "volume":
      return well.volume_um3 === null || isBound(well) ? null : well.volume_um3 / UM3_PER_NL;
    case "area":
      return well.area_um2 === null || isBound(well) ? null : well.area_um2 / 1e6;
    case "z_volume":
      return isBound(well) ? null : (well.reference?.volume.z ?? null);
    case "z_area":
      return isBound(well) ? null : (well.reference?.area.z ?? null);
    case "controls":
      return controls === null || well.volume_um3 === null || isBound(well)
        ? null
        : (well.volume_um3 - controls.mean) / controls.sd;
    case "flags":
      return well.outcome === "succeeded" ? well.flags.length : null;
    case "residual":
      return well.residual_px;
  }
}

/** `243.1 nL`, `−0.8 SD`. */
export function valueWords(value: number, by: Colouring): string {
  if (by === "volume") return `${significant(value)} nL`;
  if (by === "area") return `${significant(value)} mm²`;
  if (by === "flags") return value === 0 ? "no flag" : counted(value, "flag");
  if (by === "residual") return `${grouped(value, 2)} px`;
  return `${value > 0 ? "+" : ""}${grouped(value, 1)} SD`;
}

export interface Range {
  least: number;
  most: number;
}

/** The ends of the scale; null without a number. */
export function rangeOf(values: readonly number[], by: Colouring): Range | null {
  if (values.length === 0) return null;
  if (DISTANCES.includes(by)) return { least: -FAR_SD, most: FAR_SD };
  if (by === "flags") return { least: 0, most: Math.max(1, ...values) };
  const sorted = [...values].sort((a, b) => a - b);
  const [low, high] = [quantile(sorted, 0.25), quantile(sorted, 0.75)];
  const reach = FENCE * (high - low);
  const beyond = Math.floor(ENDS * sorted.length);
  return {
    least: Math.max(sorted[beyond]!, low - reach),
    most: Math.min(sorted[sorted.length - 1 - beyond]!, high + reach),
  };
}

/** Share of the values beyond each end of a scale. */
const ENDS = 0.02;
/** Reach of a scale beyond the quartiles, in their distance (Tukey's fences): of few wells, 2 % is less than one. */
const FENCE = 1.5;

/** A quantile by linear interpolation between the sorted values. */
function quantile(sorted: readonly number[], share: number): number {
  const at = share * (sorted.length - 1);
  const [low, high] = [sorted[Math.floor(at)]!, sorted[Math.ceil(at)]!];
  return low + (at - Math.floor(at)) * (high - low);
}

/** Whether a value lies beyond an end of the scale, by more than rounding. */
export function isBeyond(value: number, range: Range): boolean {
  const width = range.most - range.least;
  return width > 0 && (value < range.least - 0.02 * width || value > range.most + 0.02 * width);
}

export interface Colour {
  background: string;
  ink: string;
}

export function colourOf(value: number, range: Range, by: Colouring): Colour {
  const width = range.most - range.least;
  const share = width > 0 ? Math.min(1, Math.max(0, (value - range.least) / width)) : 0.5;
  return colourAt(share, by);
}

/** The colour at a share of the scale, 0 to 1. */
export function colourAt(share: number, by: Colouring): Colour {
  const stops = DISTANCES.includes(by) ? DIVERGING : SEQUENTIAL;
  const at = share * (stops.length - 1);
  const low = Math.min(stops.length - 2, Math.floor(at));
  const [from, to] = [channels(stops[low]!), channels(stops[low + 1]!)];
  const mixed = from.map((c, i) => Math.round(c + (at - low) * (to[i]! - c)));
  return { background: `rgb(${mixed.join(" ")})`, ink: contrast(mixed, 1) >= contrast(mixed, 0) ? "#fff" : "#000" };
}

function channels(hex: string): number[] {
  return [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
}

/** Contrast of a colour with white (1) or black (0), by WCAG 2. */
export function contrast(rgb: readonly number[], luminance: 0 | 1): number {
  const [r = 0, g = 0, b = 0] = rgb.map((c) => (c <= 10.3 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
  const own = 0.2126 * r + 0.7152 * g + 0.0722 * b;
  const [light, dark] = own > luminance ? [own, luminance] : [luminance, own];
  return (light + 0.05) / (dark + 0.05);
}
