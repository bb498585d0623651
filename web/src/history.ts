// Hull volumes after each view, kept per well while the page is open: the status carries only the specimen under way.

import type { Status } from "./status.ts";

export class VolumeHistory {
  #run: string | null = null;
  readonly #wells = new Map<string, readonly number[]>();

  take(status: Status): void {
    const run = status.run ? `${status.run.id} ${status.run.started}` : null;
    if (run !== this.#run) {
      this.#run = run;
      this.#wells.clear();
    }
    const specimen = status.specimen;
    if (specimen && specimen.hull_volumes_um3.length > 0) this.#wells.set(specimen.well, specimen.hull_volumes_um3);
  }

  of(well: string): readonly number[] {
    return this.#wells.get(well) ?? [];
  }
}
