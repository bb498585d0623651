// The stored records of wells. Each is requested once; if there is none, it is requested again later, because it may still come.

import { fetchSpecimen } from "./api.ts";
import type { RunStatus, Specimen } from "./status.ts";

/** Time for which a missing record is not requested again, ms. */
const NOTHING_MS = 5000;

/** A well of a run, with the start of the run: another run may have had the same name before. */
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
  /** By key, the time until which a missing record is not requested again. */
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
      // Requested again after an error, for example while the daemon is away.
      () => this.#asked.delete(key),
    );
    return asked;
  }
}
