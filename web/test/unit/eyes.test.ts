// The eyes in words.

import assert from "node:assert/strict";
import { test } from "node:test";
import { eyesWords } from "../../src/eyes.ts";
import type { StoredEye } from "../../src/status.ts";

const eye = (half: [number, number, number], more: Partial<StoredEye> = {}): StoredEye => ({
  side: "left",
  volume_um3: 9.4e6,
  volume_sd_um3: 0.5e6,
  centre_um: [1000, 50, 0],
  half_axes_um: half,
  spread_um2: [half[0] ** 2, half[1] ** 2, half[2] ** 2, 0, 0, 0],
  residual_px: 1,
  ...more,
});

test("eyes are said with their sides, or why they were not found", () => {
  const nothing = { mean_volume_um3: null, mean_volume_sd_um3: null, axis_angle_deg: null };
  const both = {
    ...nothing,
    eyes: [eye([1, 1, 1]), eye([1, 1, 1], { side: "right" })],
    distance_um: 310.4,
    distance_sd_um: 4.6,
  };
  assert.match(
    eyesWords({ ...both, reason: null }),
    /^Eyes \(± 1 SD\): left 9\.40 ± 0\.50.nL, right 9\.40 ± 0\.50.nL, 310 ± 5.µm apart\.$/u,
  );
  const one = { ...nothing, eyes: [eye([1, 1, 1], { side: null })], distance_um: null, distance_sd_um: null };
  assert.match(
    eyesWords({ ...one, reason: "only_one" }),
    /^Eyes \(± 1 SD\): 9\.40 .* One was not found: only one part/,
  );
  assert.match(eyesWords({ ...one, eyes: [], reason: "not_dark" }), /^Eyes: not found, because no part/);
  assert.equal(eyesWords(null), "");
});
