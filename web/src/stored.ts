// The stored records of wells. Each is requested once; if there is none, it is requested again later, because it may still come. The record of a
// well that is measured again is forgotten.

import type { BufferGeometry } from "three";
import { fetchFile, fetchSpecimen } from "./api.ts";
import { parseGlb } from "./glb.ts";
import { Recent } from "./recent.ts";
import type { RunStatus, Specimen } from "./status.ts";

/** Time for which a missing record is not requested again, ms. */
const NOTHING_MS = 5000;
/** The records that are kept. One has some 100 kB, and a person looks at a few wells. */
const KEPT = 8;

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
  /** By key, what was requested, and the time until which it is not requested again. */
  readonly #asked = new Recent<{ found: Promise<Specimen | null>; until: number }>(KEPT);
  readonly #fetch: typeof fetchSpecimen;
  readonly #now: () => number;

  constructor(fetch = fetchSpecimen, now = () => performance.now()) {
    this.#fetch = fetch;
    this.#now = now;
  }

  of(one: StoredWell): Promise<Specimen | null> {
    const key = wellKey(one);
    const known = this.#asked.get(key);
    if (known && this.#now() < known.until) return known.found;
    const asked = { found: this.#fetch(one.run, one.well), until: Infinity };
    this.#asked.set(key, asked);
    asked.found.then(
      (found) => {
        if (found === null) asked.until = this.#now() + NOTHING_MS;
      },
      // Requested again after an error, for example while the daemon is away.
      () => (asked.until = -Infinity),
    );
    return asked.found;
  }

  /** Forgets the records of the wells that have no result now: what was stored of them is no longer theirs. */
  see(run: Pick<RunStatus, "id" | "started" | "results"> | null): void {
    for (const { well, outcome } of run?.results ?? [])
      if (run !== null && outcome === null) this.#asked.delete(wellKey({ run: run.id, started: run.started, well }));
  }
}

/** The models of stored wells. Only the newest is kept: it has some megabytes, and two views of the page use it at the same time. */
export class StoredModels {
  readonly #specimens: StoredSpecimens;
  readonly #link: (links: Specimen["links"]) => string | null | undefined;
  #newest: { of: Promise<Specimen | null>; model: Promise<BufferGeometry | null> } | null = null;

  constructor(specimens: StoredSpecimens, link: (links: Specimen["links"]) => string | null | undefined) {
    this.#specimens = specimens;
    this.#link = link;
  }

  /** Whether there is a model. */
  async has(one: StoredWell): Promise<boolean> {
    const found = await this.#specimens.of(one);
    return found !== null && Boolean(this.#link(found.links));
  }

  /** The model; null if none is stored. */
  of(one: StoredWell): Promise<BufferGeometry | null> {
    const of = this.#specimens.of(one);
    if (this.#newest?.of === of) return this.#newest.model;
    const model = this.#read(of);
    this.#newest = { of, model };
    const forget = () => {
      if (this.#newest?.model === model) this.#newest = null;
    };
    // Requested again after an error, and where there is none yet.
    model.then((found) => found ?? forget(), forget);
    return model;
  }

  async #read(of: Promise<Specimen | null>): Promise<BufferGeometry | null> {
    const found = await of;
    const link = found && this.#link(found.links);
    return link ? parseGlb(await fetchFile(link)) : null;
  }
}
