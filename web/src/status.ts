// The types of the API. contract.ts is generated from docs/openapi.json; this file has the parts of stored documents that the page reads.

import type {
  Event as RunEvent,
  SpecimenDetail,
  StoredCalibrationRecord,
  StoredEstimateStanding,
  StoredEyes,
  StoredFacing,
  StoredMeasurementFile,
  StoredRigRecord,
  StoredSwimBladder,
} from "./contract.ts";

export type * from "./contract.ts";
/** An event of the journal. `Event` itself is a type of the browser. */
export type { RunEvent };

/** The parts of `recording.json` that the page reads. */
export interface Recorded {
  rig: Pick<StoredRigRecord, "camera">;
}

/** The parts of `measurement.json` that the page reads. */
export interface Measured extends Pick<StoredMeasurementFile, "views"> {
  calibration?: Pick<StoredCalibrationRecord, "psi" | "rho"> | null;
  shape?: { body?: { dorsal: { direction?: readonly number[] | null } } | null } | null;
  facing?: Pick<StoredFacing, "confidence" | "head_confidence"> | null;
  eyes?: Pick<StoredEyes, "eyes" | "reason" | "distance_um" | "distance_sd_um"> | null;
  bladder?: Pick<
    StoredSwimBladder,
    "state" | "reason" | "lobes" | "volume_um3" | "volume_sd_um3" | "length_um" | "length_sd_um"
  > | null;
  reference?: { estimates: Pick<StoredEstimateStanding, "estimator" | "volume" | "area">[] } | null;
}

/** `GET /v1/runs/{run_id}/specimens/{well}`, with the parts of `recording.json` and `measurement.json` that the page reads. */
export type Specimen = Omit<SpecimenDetail, "recording" | "measurement"> & {
  recording: Recorded;
  measurement: Measured | null;
};
