// The types of the API. contract.ts is generated from docs/openapi.json; this file narrows types that the contract leaves open.

import type { SpecimenDetail } from "./contract.ts";

export type * from "./contract.ts";

/** `GET /v1/runs/{run_id}/specimens/{well}`, with the parts of `recording.json` that the page reads. */
export type Specimen = Omit<SpecimenDetail, "recording"> & { recording: { rig?: { pixel_format?: string } } };
