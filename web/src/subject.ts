// Which specimen's pictures the page shows: those of the run as it proceeds, or the stored ones of the well that the operator chose. Pure.
//
//   no well chosen ──> the newest pictures; of a run that is held or has ended, those of the well whose numbers are shown
//   chosen, under way ──> the newest pictures, if they are of that well
//   chosen, measured ──> stored

import { underWay } from "./plain.ts";
import type { Status, WellStatus } from "./status.ts";
import type { StoredWell } from "./stored.ts";
import { CONDITIONS, conditionOf } from "./wells.ts";

export type Subject =
  /** The newest pictures of this run; only those of `well`, if it is given. */
  | { kind: "live"; run: string; well: string | null }
  | ({ kind: "stored" } & StoredWell)
  | { kind: "none"; words: string };

/** The well to show: the operator's choice, else the current one, else the last that ended. */
export function chosenWell(status: Status, pinned: string | null): string | null {
  const wells = status.run?.results ?? [];
  // A held run has something to show of the next well only if that was begun.
  const begun = status.specimen?.in_capillary === true || (status.specimen?.view ?? 0) > 0;
  const current = status.state !== "Held" || begun ? status.specimen?.well : null;
  for (const name of [pinned, current]) if (name != null && wells.some((w) => w.well === name)) return name;
  const ended = wells.filter((w) => w.outcome !== null);
  return (lastMeasured(wells) ?? ended.at(-1) ?? wells[0])?.well ?? null;
}

function lastMeasured(wells: readonly WellStatus[]): WellStatus | undefined {
  return wells.findLast((w) => w.volume_um3 !== null);
}

/** Whether something is certainly stored, at least the frame that judged a skipped well. A well that an abort left out may have nothing. */
export function isStored(well: WellStatus): boolean {
  return well.outcome === "succeeded" || well.outcome === "failed" || well.outcome === "skipped";
}

export function subjectOf(status: Status, pinned: string | null): Subject {
  const run = status.run;
  if (run === null) return { kind: "none", words: "There has been no run yet." };
  const last = run.outcome === null ? undefined : lastMeasured(run.results);
  const pinnedWell = run.results.find((w) => w.well === pinned);
  // A held run shows the well that its numbers are of, and not the newest pictures of another one.
  const held = status.state === "Held" ? run.results.find((w) => w.well === chosenWell(status, null)) : undefined;
  const well = pinnedWell ?? held ?? last;
  if (!well) return { kind: "live", run: run.id, well: null };
  if (isStored(well)) return { kind: "stored", run: run.id, started: run.started, well: well.well };
  const condition = conditionOf(well, underWay(status), run.results);
  const isHeld = well === held && well.well === status.specimen?.well;
  if (isHeld || condition === "active" || condition === "measuring")
    return { kind: "live", run: run.id, well: well.well };
  const label = CONDITIONS[condition].label;
  return { kind: "none", words: `Well ${well.well}: ${label}, so there is no picture of it.` };
}
