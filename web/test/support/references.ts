// A number of a larva among reference larvae, as `measurement.json` has it.

import type { StoredPlaceAnswer } from "../../src/status.ts";

/** An area of 12 larvae of 3 dpf. */
export function areaPlace(z: number, percentile: number): StoredPlaceAnswer {
  const interval: [number, number] = [2.86e6, 3.54e6];
  const scores = { z, t: z, p: 0.2, percentile };
  return {
    known: { group: "fixed, 3 dpf", n: 12, mean: 3.2e6, sd: 150_000, ...scores, interval_95: interval, mismatches: [] },
  };
}

/** There are no references with volumes. */
export const noVolumePlace: StoredPlaceAnswer = {
  missing: { quantity: "volume", reason: "quantity", there_are: [], why: [] },
};
