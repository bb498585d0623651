// Volumes after each view, per well: estimates and hulls. They come from the status for the current specimen, and from earlier statuses or
// the stored record for the others.

import { runKey } from "./stored.ts";
import type { RunStatus, Status, VolumeEstimate } from "./status.ts";

export interface Volumes {
  /** The hull after each view. */
  hulls_um3: readonly number[];
  estimates: readonly VolumeEstimate[];
}

const NOTHING: Volumes = { hulls_um3: [], estimates: [] };

export class VolumeHistory {
  #run = "";
  readonly #wells = new Map<string, Volumes>();

  take(status: Status): void {
    const run = status.run === null ? "" : runKey(status.run);
    if (run !== this.#run) {
      this.#run = run;
      this.#wells.clear();
    }
    const specimen = status.specimen;
    if (!specimen) return;
    const isOpen = status.run?.results.some((w) => w.well === specimen.well && w.outcome === null);
    // A turn that begins again has no views: those of the attempt before are not its own.
    if (isOpen || specimen.hull_volumes_um3.length > 0) {
      this.#wells.set(specimen.well, { hulls_um3: specimen.hull_volumes_um3, estimates: specimen.estimates });
    }
  }

  /** Takes the stored volumes of a well if there are more than this page has seen. Returns whether it took them. */
  recall(run: RunStatus, well: string, volumes: Volumes): boolean {
    const isMore = this.#run === runKey(run) && volumes.hulls_um3.length > this.of(well).hulls_um3.length;
    if (isMore) this.#wells.set(well, volumes);
    return isMore;
  }

  of(well: string): Volumes {
    return this.#wells.get(well) ?? NOTHING;
  }
}
