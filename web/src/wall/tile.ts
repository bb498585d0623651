// What the page of several instruments says of one of them. Pure.

import { needsSomebody } from "../calls.ts";
import { duration, unbroken } from "../format.ts";
import { count, finish, headline, progressLine, plateName, STATES, toneOf, type Tone } from "../plain.ts";
import type { Status } from "../status.ts";
import { doneWords } from "../wells.ts";

/** Age up to which a status is shown as that of now, s. The page of one instrument is live as long. */
const LIVE_S = 2;
/** Age from which on somebody is needed, s. A busy machine may be silent for some seconds. */
const OLD_S = 8;

export interface Tile {
  name: string;
  isSimulated: boolean;
  tone: Tone;
  state: string;
  /** What a person has to do now; null if nobody is needed. */
  needed: string | null;
  words: string;
  plate: string;
  count: string;
  finish: string;
  /** The numbers of the well that was finished last. */
  last: string;
  trouble: string | null;
}

/** From some metres only the colour is seen: a run that goes on by a person's hand needs one, too. */
function toneWith(needed: string | null, tone: Tone): Tone {
  return needed !== null && tone !== "alarm" ? "attention" : tone;
}

/**
 * `status` is `ageS` old, or null before the first one. What is older than a moment is not shown as the state of now, and an instrument that
 * does not answer for longer needs somebody.
 */
export function tileOf(address: string, status: Status | null, trouble: string | null, ageS: number): Tile {
  if (status === null) {
    const words = trouble === null ? "Connecting …" : `No status: ${trouble}.`;
    const needed = trouble === null ? null : words;
    const none = { isSimulated: false, plate: "", count: "", finish: "", last: "", trouble: null };
    return { ...none, name: address, tone: needed ? "alarm" : "calm", state: needed ? "No status" : "", needed, words };
  }
  const { run } = status;
  const isLate = ageS > LIVE_S;
  const isOld = trouble !== null && ageS > OLD_S;
  const silent = `No answer for ${duration(ageS)}${trouble === null ? "" : `: ${trouble}`}. What is shown is that old.`;
  // Wells that a person or the end of the run left out say nothing of the instrument.
  const done = run?.results.findLast((well) => well.outcome === "succeeded" || well.outcome === "failed");
  const needed = isOld ? silent : needsSomebody(status) ? headline(status) : null;
  const now = toneWith(needed, toneOf(status));
  // What was heard before is not the state of now. What needs a look stays so.
  const tone = isLate && (now === "busy" || now === "good") ? "calm" : now;
  return {
    name: status.instrument.name,
    isSimulated: status.mode === "simulated",
    tone: isOld ? "alarm" : tone,
    state: isOld ? "Silent" : isLate ? "No answer" : STATES[status.state],
    needed,
    words: run === null && status.ready ? headline(status) : progressLine(status),
    plate: plateName(status),
    count: count(status),
    finish: finish(status),
    last: done === undefined ? "" : `Last: ${done.well} ${unbroken(doneWords(done))}`,
    trouble: isOld ? null : isLate ? silent : trouble && `${trouble}.`,
  };
}
