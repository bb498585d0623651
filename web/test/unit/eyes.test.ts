// Where a view shows an eye, and its numbers in words.

import assert from "node:assert/strict";
import { test } from "node:test";
import { ellipseOf, eyesWords } from "../../src/eyes.ts";
import { projectionOf } from "../../src/projection.ts";
import type { StoredEye } from "../../src/status.ts";

const camera = { f: 1e7, kx: 0.2, ky: 0.1, ux: 500, uy: 100, width: 1000, height: 200 };

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

test("an eye is seen as an ellipse of its half axes at the scale of the camera", () => {
  const seen = ellipseOf(eye([150, 120, 70]), projectionOf(camera, 0))!;
  for (const [found, expected] of [
    [seen.u, 700],
    [seen.v, 105],
    [seen.half[0], 30],
    [seen.half[1], 12],
  ] as const)
    assert.ok(Math.abs(found - expected) < 0.01, JSON.stringify(seen));
  assert.ok(Math.abs(Math.sin(seen.angle)) < 1e-3, JSON.stringify(seen));
  // After a quarter of a turn its depth lies across the capillary.
  const turned = ellipseOf(eye([150, 120, 70]), projectionOf(camera, Math.PI / 2))!;
  assert.ok(Math.abs(turned.half[1] - 7) < 0.01, JSON.stringify(turned));
});

test("a tilted ellipsoid is seen tilted", () => {
  // Half axes of 200 and 50 um at 45 degrees in the plane of the picture, at one scale.
  const [long, short] = [200 ** 2, 50 ** 2];
  const spread_um2: StoredEye["spread_um2"] = [
    (long + short) / 2,
    (long + short) / 2,
    50 ** 2,
    (long - short) / 2,
    0,
    0,
  ];
  const seen = ellipseOf(eye([200, 50, 50], { spread_um2 }), projectionOf({ ...camera, ky: 0.2 }, 0))!;
  assert.ok(Math.abs(seen.angle - Math.PI / 4) < 1e-3 && Math.abs(seen.half[0] - 40) < 0.01, JSON.stringify(seen));
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
