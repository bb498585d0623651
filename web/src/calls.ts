// When the page calls for a person. Pure.

import { headline, progressLine, runsNow, STATES } from "./plain.ts";
import type { Status } from "./status.ts";

export interface Call {
  title: string;
  words: string;
}

/** Whether a person has to do something now. */
export function needsSomebody(status: Status): boolean {
  const byHand = status.run !== null && (status.plate.take_out !== null || status.plate.bring !== null);
  return (
    status.faults.some((fault) => fault.operator_required) || (runsNow(status) && status.state === "Held") || byHand
  );
}

/** The call that a change of the status makes; null without one. The first status of a page makes none. */
export function callFor(before: Status | null, now: Status): Call | null {
  if (before === null) return null;
  if (needsSomebody(now) && (!needsSomebody(before) || headline(before) !== headline(now))) {
    return { title: `carved: ${STATES[now.state]}`, words: headline(now) };
  }
  const hasEnded = runsNow(before) && now.run?.id === before.run?.id && now.run?.outcome != null;
  return hasEnded ? { title: "carved: the run has ended", words: progressLine(now) } : null;
}
