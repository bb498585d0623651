// The position of a well on its plate, and its condition.

import { capitalised } from "./format.ts";
import { reasonWords } from "./reasons.ts";
import type { SpecimenStatus, WellStatus } from "./status.ts";

export interface PlateFormat {
  rows: number;
  columns: number;
}

export const PLATE_96: PlateFormat = { rows: 8, columns: 12 };
export const PLATE_384: PlateFormat = { rows: 16, columns: 24 };

/** Row and column from 0, or null for a name that exists on no plate. */
export function place(well: string): { row: number; column: number } | null {
  const match = /^([A-P])(\d\d)$/.exec(well);
  if (!match) return null;
  const row = match[1]!.charCodeAt(0) - 65;
  const column = Number(match[2]) - 1;
  return column >= 0 && column < 24 ? { row, column } : null;
}

export function wellName(row: number, column: number): string {
  return String.fromCharCode(65 + row) + String(column + 1).padStart(2, "0");
}

/** The smaller plate, unless a well is outside it. */
export function formatFor(wells: readonly string[]): PlateFormat {
  const outside = wells.some((name) => {
    const at = place(name);
    return at !== null && (at.row >= PLATE_96.rows || at.column >= PLATE_96.columns);
  });
  return outside ? PLATE_384 : PLATE_96;
}

export type Condition =
  "pending" | "active" | "measuring" | "succeeded" | "flagged" | "skipped" | "failed" | "interrupted" | "aborted";

/** A sign and words for each condition, so that colour is not the only indication. */
export const CONDITIONS: Record<Condition, { sign: string; label: string }> = {
  pending: { sign: "·", label: "not measured yet" },
  active: { sign: "▶", label: "under way" },
  measuring: { sign: "…", label: "being measured" },
  succeeded: { sign: "✓", label: "measured" },
  flagged: { sign: "!", label: "measured, flagged" },
  skipped: { sign: "–", label: "skipped" },
  failed: { sign: "✕", label: "failed" },
  interrupted: { sign: "‖", label: "not finished" },
  aborted: { sign: "■", label: "not finished" },
};

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
    default:
      return well.outcome;
  }
}

function isBefore(well: string, other: string | undefined, wells: readonly WellStatus[]): boolean {
  return wells.findIndex((w) => w.well === well) < wells.findIndex((w) => w.well === other);
}

/** `larva, 3 dpf`, `bead`. */
export function contents(well: WellStatus): string {
  return well.dpf === null ? well.specimen : `${well.specimen}, ${well.dpf} dpf`;
}

/** The comparison with reference larvae: one sentence per number, followed by the conditions that differ. */
export function places(well: WellStatus): { text: string; doubts: string }[] {
  if (well.reference === null) return [];
  return [well.reference.volume, well.reference.area].map(({ words, mismatches }) => ({
    text: `${capitalised(words)}.`,
    doubts: mismatches.length === 0 ? "" : `Not the same or not known: ${mismatches.join("; ")}.`,
  }));
}

/** One line for a screen reader and the tooltip. */
export function spoken(well: WellStatus, condition: Condition): string {
  const reason = well.reason === null ? "" : `: ${reasonWords(well.reason)}`;
  return `${well.well}, ${contents(well)}, ${CONDITIONS[condition].label}${reason}`;
}
