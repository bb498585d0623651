// The types of the API. contract.ts is generated from docs/openapi.json; what the contract leaves open is narrowed here.

import type { SpecimenDetail } from "./contract.ts";

export type * from "./contract.ts";

/** `GET /v1/runs/{run_id}/specimens/{well}`, with what the page reads of `recording.json`. */
export type Specimen = Omit<SpecimenDetail, "recording"> & { recording: { rig?: { pixel_format?: string } } };
