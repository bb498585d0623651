// What is stored of a well, asked for once.

import { fetchSpecimen } from "./api.ts";
import type { Specimen } from "./status.ts";

export class StoredSpecimens {
  readonly #asked = new Map<string, Promise<Specimen | null>>();

  of(run: string, well: string): Promise<Specimen | null> {
    const key = `${run}/${well}`;
    const known = this.#asked.get(key);
    if (known) return known;
    const asked = fetchSpecimen(run, well);
    this.#asked.set(key, asked);
    // Asked again where the daemon was away.
    asked.catch(() => this.#asked.delete(key));
    return asked;
  }
}
