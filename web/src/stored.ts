// What is stored of a well, asked for once; where nothing is, again after a while: it may come yet.

import { fetchSpecimen } from "./api.ts";
import type { RunStatus, Specimen } from "./status.ts";

/** How long nothing stays nothing, ms. */
const NOTHING_MS = 5000;

/** A well of a run, which its name alone does not tell from another that had it before. */
export interface StoredWell {
  run: string;
  started: string;
  well: string;
}

export function runKey(run: Pick<RunStatus, "id" | "started">): string {
  return `${run.id} ${run.started}`;
}

export function wellKey({ run, started, well }: StoredWell): string {
  return `${runKey({ id: run, started })}/${well}`;
}

export class StoredSpecimens {
  readonly #asked = new Map<string, Promise<Specimen | null>>();
  readonly #fetch: typeof fetchSpecimen;
  readonly #now: () => number;
  /** Until when nothing is nothing. */
  readonly #nothing = new Map<string, number>();

  constructor(fetch = fetchSpecimen, now = () => performance.now()) {
    this.#fetch = fetch;
    this.#now = now;
  }

  of(one: StoredWell): Promise<Specimen | null> {
    const key = wellKey(one);
    const known = this.#asked.get(key);
    if (known && this.#now() < (this.#nothing.get(key) ?? Infinity)) return known;
    this.#nothing.delete(key);
    const asked = this.#fetch(one.run, one.well);
    this.#asked.set(key, asked);
    asked.then(
      (found) => found ?? this.#nothing.set(key, this.#now() + NOTHING_MS),
      // Asked again where the daemon was away.
      () => this.#asked.delete(key),
    );
    return asked;
  }
}
