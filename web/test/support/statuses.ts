// Status bodies for conditions that the emulated rig does not reach at a test's wish.

import type { Fault, ReferenceStatus, RunStatus, SpecimenStatus, Status, WellStatus } from "../../src/status.ts";

export function well(name: string, change: Partial<WellStatus> = {}): WellStatus {
  return {
    well: name,
    specimen: "larva",
    dpf: 3,
    outcome: null,
    reason: null,
    flags: [],
    estimator: null,
    volume_um3: null,
    volume_sd_um3: null,
    area_um2: null,
    area_sd_um2: null,
    field_volume_um3: null,
    field_area_um2: null,
    diameter_um: null,
    views: null,
    views_planned: null,
    residual_px: null,
    signal_per_nl: null,
    reference: null,
    note: null,
    ...change,
  };
}

/** A larva whose area has references and whose volume has none. */
export const placed: ReferenceStatus = {
  eye_volume: null,
  eye_distance: null,
  volume: {
    words: "volume: no reference of 3 dpf",
    group: null,
    n: null,
    z: null,
    percentile: null,
    mismatches: [],
  },
  area: {
    words: "area 0.8 SD below the mean of 12 larvae of 3 dpf",
    group: "fixed ABxTL, 3 dpf, ASD 21",
    n: 12,
    z: -0.8,
    percentile: 22.6,
    mismatches: ["voxel edge: 6.93 um, the reference's not stated", "mode: simulated, the reference's hardware"],
  },
};

/** A run over the given wells, its counts taken from them. */
export function run(results: WellStatus[], change: Partial<RunStatus> = {}): RunStatus {
  const count = (matches: (w: WellStatus) => boolean) => results.filter(matches).length;
  return {
    id: "demo-1",
    external_id: null,
    method: "standard",
    operator: "Kim",
    results,
    wells: {
      succeeded: count((w) => w.outcome === "succeeded" && w.flags.length === 0),
      flagged: count((w) => w.outcome === "succeeded" && w.flags.length > 0),
      failed: count((w) => w.outcome === "failed"),
      skipped: count((w) => w.outcome === "skipped"),
      interrupted: count((w) => w.outcome === "interrupted" || w.outcome === "aborted"),
      pending: count((w) => w.outcome === null),
      total: results.length,
    },
    started: "2026-03-05T09:30:00Z",
    ended: null,
    eta_s: { p50: 130, p90: 170 },
    outcome: null,
    held_by_operator: false,
    goes_on_by_itself: false,
    hold: null,
    ...change,
  };
}

export function specimen(name: string, volumes: number[], change: Partial<SpecimenStatus> = {}): SpecimenStatus {
  return {
    well: name,
    in_capillary: true,
    phase: "revolve",
    view: volumes.length,
    views_planned: 22,
    volume_um3: null,
    volume_sd_um3: null,
    volume_views: null,
    converged: null,
    volume_wait: "views",
    estimates: [],
    hull_volumes_um3: volumes,
    ...change,
  };
}

export function fault(change: Partial<Fault> = {}): Fault {
  return {
    seq: 7,
    code: "camera_silent",
    category: "camera",
    message: "The camera has sent no frame for 1.5 s",
    recoverable: true,
    scheduler_action: "retry",
    operator_required: false,
    ends_by_itself: false,
    since: "2026-03-05T09:31:12Z",
    meaning: "The camera does not answer any more.",
    what_to_do: "Look at the camera's cable.",
    ...change,
  };
}

export function status(change: Partial<Status> = {}): Status {
  return {
    schema: "carved/status/1",
    revision: 1,
    boot_id: "b7d1",
    server_time: "2026-03-05T09:31:20Z",
    uptime_s: 754,
    version: "0.1.0",
    instrument: {
      name: "vast-1",
      serial: "0042",
      location: "room 2.17",
      uuid: "0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11",
    },
    mode: "simulated",
    ready: true,
    not_ready_reason: null,
    state: "Idle",
    doing: "waiting for a run",
    pending: { hold: false, stop: false, abort: false },
    plate: { barcode: null, present: false, removable: true, needs: null, take_out: null, bring: null },
    queue: [],
    run: null,
    specimen: null,
    hardware: {
      rotation: {
        identity: "Grbl 1.1h",
        connected: true,
        referenced: true,
        can_stop: true,
        outside: false,
        position_steps: 1523,
        position_deg: 171.3375,
      },
      translation: null,
      outputs: [],
      camera: {
        identity: "Prosilica GE1050",
        connected: true,
        completed_frames: 1204,
        failed_frames: 0,
        missing_packets: 0,
        resent_packets: 0,
        ignored_packets: 0,
        light: { background: 201, saturated: 0, focus: 0.00123 },
      },
      camera_second: null,
      disk_free_bytes: 412_300_000_000,
      index_trouble: null,
    },
    notices: null,
    calibration: null,
    faults: [],
    ...change,
  };
}

/** Volumes of a hull that is carved: large at first, then settling at `last`. */
export function carved(last: number, views: number): number[] {
  return Array.from({ length: views }, (_, i) => Math.round(last * (1 + 2.4 * Math.exp(-i / 2.2))));
}
