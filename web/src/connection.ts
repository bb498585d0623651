// Keeps the page up to date with successive long polls, and shows when they fail.
//
//   first ──ok──> poll(after) ──ok──> poll(after) ...
//     ^              │ error, silence, a command without an answer
//     ├── pause <── lost
//     └── pause <── refused, because too many clients wait: the connection is not lost

import { fetchStatus, Refused, watchCommands } from "./api.ts";
import type { Status } from "./status.ts";

/** Longest duration of a poll at the daemon, s. It is short, so that a pulled cable is noticed soon. */
const WAIT_S = 5;
/** Silence after the end of a poll that counts as a lost connection, ms. */
const GRACE_MS = 3000;
/** Pauses between attempts, ms. The last one repeats. */
const PAUSES_MS = [250, 500, 1000, 2000];
/** Pause after a poll that was refused because too many clients wait, ms. */
const REFUSED_MS = 1000;
/** Shortest time between polls, ms: a page needs at most 10 updates a second. */
const LEAST_GAP_MS = 100;

export type Link = { kind: "connecting" } | { kind: "live" } | { kind: "lost"; why: string; tokenWanted: boolean };

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
  let failures = 0;
  let patience = new AbortController();
  watchCommands(() => patience.abort());
  for (;;) {
    patience = new AbortController();
    const timer = setTimeout(() => patience.abort(), GRACE_MS + (after === null ? 0 : WAIT_S * 1000));
    try {
      const started = performance.now();
      const status = await fetchStatus(after, WAIT_S, patience.signal);
      const unchanged = status.revision === after;
      after = status.revision;
      failures = 0;
      listener.link({ kind: "live" });
      listener.status(status);
      // Without this pause an immediate answer without news would make the loop spin.
      const gap = unchanged ? 1000 : LEAST_GAP_MS;
      await pause(Math.max(0, gap - (performance.now() - started)));
    } catch (error) {
      if (error instanceof Refused && error.code === 503 && after !== null) {
        after = null;
        await pause(REFUSED_MS);
        continue;
      }
      // A restarted daemon counts its revisions from the beginning, so the next request has no `after`.
      after = null;
      const tokenWanted = error instanceof Refused && error.code === 401;
      listener.link({ kind: "lost", why: reason(error), tokenWanted });
      await pause(PAUSES_MS[Math.min(failures, PAUSES_MS.length - 1)]!);
      failures += 1;
    } finally {
      clearTimeout(timer);
    }
  }
}
