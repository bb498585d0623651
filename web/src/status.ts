// The types of the API. contract.ts is generated from docs/openapi.json; this file narrows types that the contract leaves open.

import type { Event as RunEvent, SpecimenDetail } from "./contract.ts";

export type * from "./contract.ts";
/** An event of the journal. `Event` itself is a type of the browser. */
export type { RunEvent };

/** The free edge of a fin in a view: `[u, v]`, px. */
export type FinCurve = [number, number][];

/** A camera as recordings have it. docs/calibration.md explains the parameters. */
export interface Psi {
  f: number;
  kx: number;
  ky: number;
  ux: number;
  uy: number;
  s?: number;
  alpha?: number;
  gamma?: number;
  phi?: number;
  width: number;
  height: number;
}

/** What is recorded of a view beside its frame. */
export interface ViewRecord {
  index: number;
  omega: number;
  used: boolean;
  reason: string | null;
  dy_px?: number | null;
  residual_px?: number | null;
  quality?: { edge_error_px: number; edge_contrast_sigma: number; wall_contact_share: number } | null;
  fins_px?: FinCurve[];
}

/** Where a number of a larva is among those of reference larvae. */
export interface KnownPlace {
  group: string;
  n: number;
  mean: number;
  sd: number;
  z: number;
  percentile: number;
}

/** The parts of `recording.json` that the page reads. */
export interface Recorded {
  rig?: { pixel_format?: string; camera?: Psi };
}

/** The parts of `measurement.json` that the page reads. */
export interface Measured {
  calibration?: { psi: Psi; rho: number } | null;
  views?: ViewRecord[];
  reference?: { estimates: { estimator: string; volume: Place; area: Place }[] } | null;
}

type Place = { known?: KnownPlace };

/** `GET /v1/runs/{run_id}/specimens/{well}`, with the parts of `recording.json` and `measurement.json` that the page reads. */
export type Specimen = Omit<SpecimenDetail, "recording" | "measurement"> & {
  recording: Recorded;
  measurement: Measured | null;
};
