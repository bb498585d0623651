// Keeps the page up to date with successive long polls, and shows when they fail.
//
//   first ──ok──> poll(after) ──ok──> poll(after) ...
//     ^              │ no answer for 2 s: silent
//     │              │ error, longer silence, a command without an answer
//     ├── pause <── lost
//     └── pause <── refused, because too many clients wait: the connection is not lost

import { fetchStatus, Refused, watchCommands } from "./api.ts";
import type { Status } from "./status.ts";

/** Longest duration of a poll at the daemon, s. A daemon that is alive answers so often, also without news. */
const WAIT_S = 1;
/** Age of the last answer up to which the page is live, ms. */
const LIVE_MS = 2000;
/** Age at which the connection counts as lost, ms. A busy machine may be silent for some seconds. */
const LOST_MS = 8000;
/** Pauses between attempts, ms. The last one repeats. */
const PAUSES_MS = [250, 500, 1000, 2000];
/** Pause after a poll that was refused because too many clients wait, ms. */
const REFUSED_MS = 1000;
/** Shortest time between polls, ms: a page needs at most 10 updates a second. */
const LEAST_GAP_MS = 100;

export type Link =
  | { kind: "connecting" }
  | { kind: "live" }
  /** `since` is the time of the last answer on the clock of `performance.now()`. */
  | { kind: "silent"; since: number }
  | { kind: "lost"; why: string; tokenWanted: boolean };

export interface Listener {
  status(status: Status): void;
  link(link: Link): void;
}

const pause = (ms: number) => new Promise<void>((resolve) => setTimeout(resolve, ms));

function reason(error: unknown): string {
  if (error instanceof Refused) return error.code === 0 ? error.message : `the daemon answered: ${error.message}`;
  if (error instanceof DOMException) return "the daemon does not answer";
  console.error(error);
  return `the page cannot show the daemon's answer: ${String(error)}`;
}

export async function keepLive(listener: Listener): Promise<never> {
  listener.link({ kind: "connecting" });
  let after: number | null = null;
  /** When the daemon was heard last, on the clock of `performance.now()`. Null while the page is not live. */
  let heard: number | null = null;
  let failures = 0;
  let patience = new AbortController();
  watchCommands(() => patience.abort());
  for (;;) {
    patience = new AbortController();
    const started = performance.now();
    const since = heard;
    const quiet =
      since === null
        ? undefined
        : setTimeout(() => listener.link({ kind: "silent", since }), since + LIVE_MS - performance.now());
    const timer = setTimeout(() => patience.abort(), LOST_MS);
    try {
      const status = await fetchStatus(after, WAIT_S, patience.signal);
      const unchanged = status.revision === after;
      after = status.revision;
      failures = 0;
      heard = performance.now();
      listener.link({ kind: "live" });
      listener.status(status);
      // Without this pause an immediate answer without news would make the loop spin.
      const gap = unchanged ? 1000 : LEAST_GAP_MS;
      await pause(Math.max(0, gap - (performance.now() - started)));
    } catch (error) {
      if (error instanceof Refused && error.code === 503 && after !== null) {
        after = null;
        heard = performance.now();
        await pause(REFUSED_MS);
        continue;
      }
      // A restarted daemon counts its revisions from the beginning, so the next request has no `after`.
      after = null;
      heard = null;
      const tokenWanted = error instanceof Refused && error.code === 401;
      listener.link({ kind: "lost", why: reason(error), tokenWanted });
      await pause(PAUSES_MS[Math.min(failures, PAUSES_MS.length - 1)]!);
      failures += 1;
    } finally {
      clearTimeout(quiet);
      clearTimeout(timer);
    }
  }
}
