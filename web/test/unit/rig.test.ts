import assert from "node:assert/strict";
import { test } from "node:test";
import {
  calibrationWords,
  focusWords,
  gateWords,
  lightWords,
  noticesWords,
  outputWords,
  toLookAt,
} from "../../src/rig.ts";

const beads = {
  id: "0123456789ab",
  kind: "beads",
  measured: "2026-03-05T09:30:00Z",
  age_s: 3 * 86400 + 50,
  max_age_s: 30 * 86400,
  bead_bias_percent: -0.218,
  valid: true,
  gate: null,
};

test("a calibration is one line: by what, how old, how far off, and whether it still counts", () => {
  assert.equal(calibrationWords(beads), "✓ by beads, 3 days old, beads −0.22 %");
  assert.equal(
    calibrationWords({ ...beads, kind: "scale", bead_bias_percent: null, age_s: 31 * 86400, valid: false }),
    "! by scale, 31 days old, valid for 30 days",
  );
  assert.equal(
    calibrationWords({ ...beads, age_s: 7300, bead_bias_percent: 0.5 }),
    "✓ by beads, 2 h old, beads +0.50 %",
  );
  assert.equal(calibrationWords(null), "! scale never checked with beads");
});

test("what somebody has to look at stands beside the heading", () => {
  const rows: [string, string][] = [
    ["Rotation", "✓ at 0.00°"],
    ["Camera", "✕ not connected"],
    ["Outputs", "light on, ! pump off: no answer"],
    ["Calibration", "! scale never checked with beads"],
  ];
  assert.equal(
    toLookAt(rows),
    "✕ Camera: not connected; ! Outputs: light on, ! pump off: no answer; ! Calibration: scale never checked with beads",
  );
  assert.equal(toLookAt(rows.slice(0, 1)), "✓ nothing to look at");
});

test("daily beads say in words what is so, and whether it counts", () => {
  const failed = {
    id: "beads-7",
    measured: "2026-03-05T07:00:00Z",
    max_age_s: 86_400,
    verdict: "failed",
    stands: false,
    summary: "",
    words: ["failed: 7 beads. Measure no specimens", "no bead was measured twice"],
  };
  assert.equal(gateWords(failed), "✕ Failed: 7 beads. Measure no specimens. No bead was measured twice.");
  assert.match(gateWords({ ...failed, stands: true }), /^✓ /);
  const passed = { ...failed, verdict: "passed", stands: true, summary: "Passed: 5 beads. Next: measure specimens." };
  assert.equal(gateWords(passed), "✓ Passed: 5 beads. Next: measure specimens.");
  assert.match(
    gateWords({ ...passed, stands: false, measured: "2999-01-01T00:00:00Z" }),
    /^! The date of these beads is in the future/,
  );
  assert.match(gateWords({ ...passed, stands: false }), /^! Too old: measure beads again\. .*Passed: 5 beads/);
  assert.equal(calibrationWords({ ...beads, kind: "gate", gate: failed }), calibrationWords(null));
});

test("an output has its state, and the reason where it could not be switched", () => {
  assert.equal(outputWords({ name: "light", state: "on", trouble: null }), "light on");
  assert.equal(outputWords({ name: "light", state: "unknown", trouble: "error:20" }), "! light unknown: error:20");
});

test("light says when the lamp is too bright, focus compares with other views", () => {
  assert.equal(lightWords({ background: 201.4, saturated: 0.0004, focus: 0 }), "background 201 of 255");
  assert.equal(lightWords({ background: 240, saturated: 0.0312, focus: 0 }), "background 240 of 255, 3.1 % saturated");
  assert.equal(focusWords({ background: 200, saturated: 0, focus: 0.0012345 }), "1,235 (higher is sharper)");
});

test("notices that do not arrive are told with what to do", () => {
  assert.equal(noticesWords({ receiver: "https://ntfy.sh", trouble: null }), "✓ to https://ntfy.sh");
  assert.equal(noticesWords({ receiver: "https://ntfy.sh", trouble: "Check it." }), "! Check it.");
});
