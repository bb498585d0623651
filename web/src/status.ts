// The types of the API. contract.ts is generated from docs/openapi.json; this file narrows types that the contract leaves open.

import type { SpecimenDetail } from "./contract.ts";

export type * from "./contract.ts";

/** The free edge of a fin in a view: `[u, v]`, px. */
export type FinCurve = [number, number][];

/** `GET /v1/runs/{run_id}/specimens/{well}`, with the parts of `recording.json` and `measurement.json` that the page reads. */
export type Specimen = Omit<SpecimenDetail, "recording" | "measurement"> & {
  recording: { rig?: { pixel_format?: string } };
  measurement: { views?: { index: number; fins_px?: FinCurve[] }[] } | null;
};
