// The shape of `GET /v1/status`, as far as the page reads it. The daemon's /openapi.json is the full description.

export type State =
  | "Stopped"
  | "Idle"
  | "Starting"
  | "Execute"
  | "Holding"
  | "Held"
  | "Unholding"
  | "Suspending"
  | "Suspended"
  | "Unsuspending"
  | "Completing"
  | "Complete"
  | "Stopping"
  | "Aborting"
  | "Aborted"
  | "Clearing"
  | "Resetting";

export type Phase = "load" | "detect" | "position" | "revolve" | "reconstruct" | "measure" | "eject" | "wash";

export type RunOutcome = "succeeded" | "partial" | "failed" | "aborted" | "interrupted";

export type SpecimenOutcome = "succeeded" | "failed" | "aborted" | "interrupted" | "skipped";

export type SchedulerAction =
  "retry" | "skip_well" | "reject_plate" | "abort_plate" | "pause_instrument" | "escalate_operator";

export interface Fault {
  seq: number;
  code: string;
  category: string;
  message: string;
  recoverable: boolean;
  scheduler_action: SchedulerAction;
  operator_required: boolean;
  since: string;
  meaning: string;
  what_to_do: string;
}

/** One number among the reference larvae of its age; null throughout where there are none. */
export interface PlaceStatus {
  words: string;
  group: string | null;
  n: number | null;
  z: number | null;
  percentile: number | null;
  mismatches: string[];
}

export interface ReferenceStatus {
  volume: PlaceStatus;
  area: PlaceStatus;
}

export interface WellStatus {
  well: string;
  specimen: "larva" | "bead";
  dpf: number | null;
  outcome: SpecimenOutcome | null;
  reason: string | null;
  flags: string[];
  estimator: string | null;
  volume_um3: number | null;
  volume_sd_um3: number | null;
  area_um2: number | null;
  area_sd_um2: number | null;
  field_volume_um3: number | null;
  field_area_um2: number | null;
  diameter_um: number | null;
  signal_per_nl: number | null;
  reference: ReferenceStatus | null;
}

export interface WellCounts {
  succeeded: number;
  flagged: number;
  failed: number;
  skipped: number;
  interrupted: number;
  pending: number;
  total: number;
}

export interface RunStatus {
  id: string;
  external_id: string | null;
  method: string;
  operator: string;
  wells: WellCounts;
  results: WellStatus[];
  started: string;
  ended: string | null;
  eta_s: { p50: number; p90: number } | null;
  outcome: RunOutcome | null;
  /** An operator has held it: it does not go on by itself. */
  held_by_operator: boolean;
  /** Held, and it waits for nobody. */
  goes_on_by_itself: boolean;
  /** Why it is held; null where it is not. */
  hold: Hold | null;
}

/** What holds a run. */
export interface Hold {
  /** A fault's code, `operator`, or `restart` of the daemon. */
  code: string;
  /** The same in plain words; it may be over by now. */
  cause: string;
  /** How often it has held the run since a well was finished, this time included. */
  times: number;
  /** The one thing to do next; null where the run goes on without it. */
  next_action: string | null;
}

export interface SpecimenStatus {
  well: string;
  in_capillary: boolean;
  phase: Phase;
  view: number;
  views_planned: number;
  volume_um3: number | null;
  volume_sd_um3: number | null;
  volume_views: number | null;
  converged: boolean | null;
  hull_volumes_um3: number[];
}

export interface AxisStatus {
  identity: string | null;
  connected: boolean;
  referenced: boolean;
  can_stop: boolean | null;
  position_steps: number | null;
  position_deg: number | null;
}

/** The axis along the capillary. */
export interface TranslationStatus {
  identity: string | null;
  connected: boolean;
  referenced: boolean;
  position_steps: number | null;
  position_um: number | null;
}

/** Shares and ratios of the newest view, for the operator to see lamp and focus drift. */
export interface Light {
  background: number;
  saturated: number;
  focus: number;
}

export interface CameraStatus {
  identity: string | null;
  connected: boolean;
  completed_frames: number;
  failed_frames: number;
  missing_packets: number;
  resent_packets: number;
  ignored_packets: number;
  light: Light | null;
}

/** The newest daily beads. */
export interface GateStatus {
  verdict: string;
  stands: boolean;
  words: string[];
}

/** Of the rig itself. */
export interface CalibrationStatus {
  id: string;
  kind: string;
  measured: string;
  age_s: number;
  max_age_s: number;
  bead_bias_percent: number | null;
  valid: boolean;
  gate: GateStatus | null;
}

export interface Status {
  revision: number;
  boot_id: string;
  server_time: string;
  uptime_s: number;
  version: string;
  mode: "hardware" | "simulated";
  ready: boolean;
  not_ready_reason: string | null;
  state: State;
  doing: string;
  pending: { hold: boolean; stop: boolean; abort: boolean };
  plate: {
    barcode: string | null;
    present: boolean;
    removable: boolean;
    needs: string | null;
    take_out: string | null;
    bring: string | null;
  };
  run: RunStatus | null;
  specimen: SpecimenStatus | null;
  hardware: {
    rotation: AxisStatus;
    translation: TranslationStatus | null;
    camera: CameraStatus;
    camera_second: CameraStatus | null;
    disk_free_bytes: number | null;
  };
  calibration: CalibrationStatus | null;
  faults: Fault[];
}

/** `GET /v1/runs/{run_id}/specimens/{well}`, as far as the page reads it. */
export interface Specimen {
  recording: { rig?: { pixel_format?: string } };
  hull_volumes_um3: number[];
  links: { mesh_glb: string | null; detection: string | null; views: string[]; profiles: string[] };
}

/** A well of a plan. */
export interface PlannedWell {
  well: string;
  specimen?: "larva" | "bead";
  dpf?: number | null;
  compound?: string | null;
  concentration?: number | null;
  concentration_unit?: string | null;
}

/** `GET /v1/runs/{run_id}`, as far as the page reads it. */
export interface RunDetail {
  id: string;
  mode: string;
  plate_barcode: string;
  method: string;
  plan: { plate_map: PlannedWell[] };
  results: WellStatus[];
}

/** A plate map as the daemon has read it. */
export interface PlateMap {
  plate_map: PlannedWell[];
  metadata: Record<string, unknown>;
  /** What was read otherwise than it stands in the file. */
  notes: string[];
}

/** Body of `PUT /v1/runs/{run_id}`, as far as the page writes it. */
export interface RunPlan {
  plate_barcode: string;
  method: string;
  operator: string;
  plate_map: PlannedWell[];
  metadata?: Record<string, unknown>;
}

/** A method of the instrument's configuration. */
export interface Method {
  name: string;
  asd: number;
  order: string;
  voxel_um: number;
  epsilon: number;
}

/** One precondition of a run. */
export interface Check {
  code: string;
  passed: boolean;
  /** Whether a run would be refused or fail; else its numbers are flagged or lack something. */
  blocks: boolean;
  detail: string;
  what_to_do: string | null;
}
