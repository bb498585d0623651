// The position of a well on its plate, and its condition.

import { capitalised, counted, nanolitres, squareMillimetres } from "./format.ts";
import { isBoundBy, meaningWords, reasonWords } from "./reasons.ts";
import type { PlannedWell, SpecimenStatus, WellStatus } from "./status.ts";
import { treatmentWords } from "./treatment.ts";

export interface PlateFormat {
  rows: number;
  columns: number;
}

/** The plates by their numbers of wells. Larger plates have more rows than letters: AA follows Z. */
export const PLATES: ReadonlyMap<number, PlateFormat> = new Map([
  [6, { rows: 2, columns: 3 }],
  [12, { rows: 3, columns: 4 }],
  [24, { rows: 4, columns: 6 }],
  [48, { rows: 6, columns: 8 }],
  [96, { rows: 8, columns: 12 }],
  [384, { rows: 16, columns: 24 }],
  [1536, { rows: 32, columns: 48 }],
]);

/** Row and column from 0, or null for a name that exists on no plate. */
export function place(well: string): { row: number; column: number } | null {
  const match = /^(A?)([A-Z])(\d\d)$/.exec(well);
  if (!match) return null;
  const row = (match[1] ? 26 : 0) + match[2]!.charCodeAt(0) - 65;
  const column = Number(match[3]) - 1;
  return row < 32 && column >= 0 && column < 48 ? { row, column } : null;
}

export function rowName(row: number): string {
  return (row < 26 ? "" : "A") + String.fromCharCode(65 + (row % 26));
}

export function wellName(row: number, column: number): string {
  return rowName(row) + String(column + 1).padStart(2, "0");
}

/**
 * The plate with the number of wells that the plan names. Without it, or if a well is not on that plate, it is the smallest plate of 96, 384
 * or 1536 wells that holds them all: plans of former versions name no plate, and 96 wells are the most usual ones.
 */
export function formatFor(wells: readonly string[], named: number | null = null): PlateFormat {
  const places = wells.map(place).filter((at) => at !== null);
  const holds = ({ rows, columns }: PlateFormat) => places.every((at) => at.row < rows && at.column < columns);
  const asked = named === null ? undefined : PLATES.get(named);
  const usual = [96, 384, 1536].map((count) => PLATES.get(count)!);
  return (asked && holds(asked) ? asked : usual.find(holds)) ?? PLATES.get(1536)!;
}

export type Condition =
  | "pending"
  | "active"
  | "measuring"
  | "succeeded"
  | "flagged"
  | "skipped"
  | "failed"
  | "interrupted"
  | "cut"
  | "aborted";

/** A sign and words for each condition, so that colour is not the only indication. */
export const CONDITIONS: Record<Condition, { sign: string; label: string }> = {
  pending: { sign: "·", label: "not measured yet" },
  active: { sign: "▶", label: "under way" },
  measuring: { sign: "…", label: "being measured" },
  succeeded: { sign: "✓", label: "measured" },
  flagged: { sign: "!", label: "measured, flagged" },
  skipped: { sign: "–", label: "skipped" },
  failed: { sign: "✕", label: "failed" },
  interrupted: { sign: "‖", label: "interrupted and given up" },
  cut: { sign: "◐", label: "interrupted when the run was ended" },
  aborted: { sign: "■", label: "not measured: the run was ended" },
};

/** The condition of one well in words, with the views of a well that was cut short. */
export function conditionWords(well: WellStatus, condition: Condition): string {
  const views = well.views ?? 0;
  if (condition === "cut") return `interrupted after ${counted(views, "view")}`;
  if (condition === "aborted" && well.views === 0) return "not measured: the run was ended before its first view";
  if (condition === "interrupted" && views > 0) return `interrupted and given up after ${counted(views, "view")}`;
  return CONDITIONS[condition].label;
}

/** `wells` are those of the run, in the order of measurement. */
export function conditionOf(
  well: WellStatus,
  specimen: SpecimenStatus | null,
  wells: readonly WellStatus[] = [],
): Condition {
  switch (well.outcome) {
    case null:
      if (specimen?.well === well.well) return "active";
      // The next specimen is loaded while the numbers of the previous one are computed.
      return isBefore(well.well, specimen?.well, wells) ? "measuring" : "pending";
    case "succeeded":
      return well.flags.length > 0 ? "flagged" : "succeeded";
    case "aborted":
      return (well.views ?? 0) > 0 ? "cut" : "aborted";
    default:
      return well.outcome;
  }
}

/** The conditions of all wells of a run. */
export function conditionsOf(wells: readonly WellStatus[], specimen: SpecimenStatus | null): Condition[] {
  // Looked up once: a plate may have 1536 wells.
  const active = specimen === null ? -1 : wells.findIndex((w) => w.well === specimen.well);
  return wells.map((well, i) => (well.outcome === null && i < active ? "measuring" : conditionOf(well, specimen)));
}

function isBefore(well: string, other: string | undefined, wells: readonly WellStatus[]): boolean {
  return wells.findIndex((w) => w.well === well) < wells.findIndex((w) => w.well === other);
}

/** Whether the true volume and area are larger than the numbers: part of the specimen was not measured. */
export function isBound(well: WellStatus): boolean {
  return isBoundBy(well.flags);
}

/** `larva, 3 dpf`, `bead`. */
export function contents(well: WellStatus): string {
  return well.dpf === null ? well.specimen : `${well.specimen}, ${well.dpf} dpf`;
}

/** The comparison with reference larvae: one sentence per number, followed by the conditions that differ. */
export function places(well: WellStatus): { text: string; doubts: string }[] {
  if (well.reference === null) return [];
  if (isBound(well)) return [{ text: "Not compared: part of the larva was not measured.", doubts: "" }];
  const { volume, area, eye_volume, eye_distance } = well.reference;
  return [volume, area, eye_volume, eye_distance]
    .flatMap((place) => place ?? [])
    .map(({ words, mismatches }) => ({
      text: `${capitalised(words)}.`,
      doubts: mismatches.length === 0 ? "" : `Compare with care: ${mismatches.join("; ")}.`,
    }));
}

/** One line for a screen reader and the tooltip. `planned`: the well in the plan, once that is read. */
export function spoken(well: WellStatus, condition: Condition, planned?: PlannedWell): string {
  const reason = well.reason === null ? "" : `: ${reasonWords(well.reason)}`;
  const treatment = planned === undefined ? "" : treatmentWords(planned);
  return [well.well, contents(well), treatment, `${conditionWords(well, condition)}${reason}`]
    .filter((part) => part !== "")
    .join(", ");
}

/** A finished well in one line: `245 ± 2 nL, 3.42 ± 0.02 mm², the specimen moved during the turn, and 2 more flags`. Pure. */
export function doneWords(well: WellStatus): string {
  if (well.volume_um3 === null) return conditionWords(well, conditionOf(well, null));
  const bound = isBound(well);
  const sd = (value: number | null) => (bound ? null : value);
  const numbers = [nanolitres(well.volume_um3, sd(well.volume_sd_um3))];
  if (well.area_um2 !== null) numbers.push(squareMillimetres(well.area_um2, sd(well.area_sd_um2)));
  const [first, ...others] = well.flags;
  // The card of the well has them all, and what to do.
  const more = others.length === 0 ? [] : [`and ${counted(others.length, "more flag")}`];
  const flags = first === undefined ? [] : [meaningWords(first), ...more];
  return [...numbers.map((words) => (bound ? `at least ${words}` : words)), ...flags].join(", ");
}
