// Hull volumes after each view, per well. They come from the status for the current specimen, and from earlier statuses or the stored
// record for the others.

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

  /** Takes the stored volumes of a well if there are more than this page has seen. Returns whether it took them. */
  recall(run: RunStatus, well: string, volumes: readonly number[]): boolean {
    const isMore = this.#run === runKey(run) && volumes.length > this.of(well).length;
    if (isMore) this.#wells.set(well, volumes);
    return isMore;
  }

  of(well: string): readonly number[] {
    return this.#wells.get(well) ?? [];
  }
}
