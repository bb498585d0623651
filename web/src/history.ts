// Hull volumes after each view, per well: of the specimen under way by the status, of those before by what the page has seen, else by
// what is stored.

import { runKey } from "./stored.ts";
import type { RunStatus, Status } from "./status.ts";

export class VolumeHistory {
  #run = "";
  readonly #wells = new Map<string, readonly number[]>();

  take(status: Status): void {
    const run = status.run === null ? "" : runKey(status.run);
    if (run !== this.#run) {
      this.#run = run;
      this.#wells.clear();
    }
    const specimen = status.specimen;
    if (specimen && specimen.hull_volumes_um3.length > 0) this.#wells.set(specimen.well, specimen.hull_volumes_um3);
  }

  /** Takes what is stored of a well, where that is more than the page has seen; whether it is. */
  recall(run: RunStatus, well: string, volumes: readonly number[]): boolean {
    const isMore = this.#run === runKey(run) && volumes.length > this.of(well).length;
    if (isMore) this.#wells.set(well, volumes);
    return isMore;
  }

  of(well: string): readonly number[] {
    return this.#wells.get(well) ?? [];
  }
}
