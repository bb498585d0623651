// Which specimen's pictures the page shows: those of the run as it proceeds, or the stored ones of the well that the operator chose. Pure.
//
//   no well chosen ──> the newest pictures; of a run that is held or has ended, those of the well whose numbers are shown
//   chosen, under way ──> the newest pictures, if they are of that well
//   chosen, ended with frames ──> stored

import { underWay } from "./plain.ts";
import type { Status, WellStatus } from "./status.ts";
import type { StoredWell } from "./stored.ts";
import { conditionOf, conditionWords } from "./wells.ts";

export type Subject =
  /** The newest pictures of this run; only those of `well`, if it is given. */
  | { kind: "live"; run: string; well: string | null }
  | ({ kind: "stored" } & StoredWell)
  | { kind: "none"; words: string };

/** The well to show: the operator's choice, else the current one, else the last that was measured, has views or ended. */
export function chosenWell(status: Status, pinned: string | null): string | null {
  const wells = status.run?.results ?? [];
  // A held run has something to show of the next well only if that was begun.
  const begun = status.specimen?.in_capillary === true || (status.specimen?.view ?? 0) > 0;
  const current = status.state !== "Held" || begun ? status.specimen?.well : null;
  for (const name of [pinned, current]) if (name != null && wells.some((w) => w.well === name)) return name;
  const ended = wells.filter((w) => w.outcome !== null);
  const measured = wells.findLast((w) => w.volume_um3 !== null);
  const withViews = ended.findLast((w) => (w.views ?? 0) > 0);
  return (measured ?? withViews ?? ended.at(-1) ?? wells[0])?.well ?? null;
}

/**
 * Whether something may be stored: the views, or at least the frame that judged a skipped well. Of a well that was cut short the number of
 * its views says so; early versions did not count them.
 */
export function isStored(well: WellStatus): boolean {
  if (well.outcome === "aborted" || well.outcome === "interrupted") return well.views !== 0;
  // A person left it out before its first frame.
  if (well.outcome === "skipped" && well.reason?.startsWith("skipped by ") === true) return (well.views ?? 0) > 0;
  return well.outcome !== null;
}

export function subjectOf(status: Status, pinned: string | null): Subject {
  const run = status.run;
  if (run === null) return { kind: "none", words: "There has been no run yet." };
  const pinnedWell = run.results.find((w) => w.well === pinned);
  // A run that is held or has ended shows the well that its numbers are of, and not the newest pictures of another one.
  const isAtRest = status.state === "Held" || run.outcome !== null;
  const resting = isAtRest ? run.results.find((w) => w.well === chosenWell(status, null)) : undefined;
  const well = pinnedWell ?? resting;
  if (!well) return { kind: "live", run: run.id, well: null };
  if (isStored(well)) return { kind: "stored", run: run.id, started: run.started, well: well.well };
  const condition = conditionOf(well, underWay(status), run.results);
  const isHeld = status.state === "Held" && well === resting && well.well === status.specimen?.well;
  if (isHeld || condition === "active" || condition === "measuring")
    return { kind: "live", run: run.id, well: well.well };
  const words = conditionWords(well, condition);
  if (well.outcome === null)
    return { kind: "none", words: `Well ${well.well}: ${words}, so there is no picture of it.` };
  return { kind: "none", words: `Well ${well.well}: ${words}.` };
}
