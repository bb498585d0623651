// Where a view shows the ellipsoid of an organ.

import assert from "node:assert/strict";
import { test } from "node:test";
import { ellipseOf, organsOf, type Ellipsoid } from "../../src/ellipsoid.ts";
import { projectionOf } from "../../src/projection.ts";
import type { StoredEye, StoredLobe } from "../../src/contract.ts";

const camera = { f: 1e7, kx: 0.2, ky: 0.1, ux: 500, uy: 100, width: 1000, height: 200 };

const eye = (half: [number, number, number], more: Partial<Ellipsoid> = {}): Ellipsoid => ({
  centre_um: [1000, 50, 0],
  spread_um2: [half[0] ** 2, half[1] ** 2, half[2] ** 2, 0, 0, 0],
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
  const spread_um2: Ellipsoid["spread_um2"] = [
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

test("organs are the eyes and the lobes of the swim bladder that were found", () => {
  const numbers = {
    half_axes_um: [1, 1, 1] as [number, number, number],
    residual_px: 1,
    volume_um3: 1,
    volume_sd_um3: 1,
  };
  const one: StoredEye = { ...eye([1, 1, 1]), ...numbers };
  const other: StoredLobe = { ...eye([2, 2, 2]), ...numbers };
  const eyes = { eyes: [one], reason: "only_one" as const };
  const bladder = { state: "inflated" as const, reason: null, lobes: [other] };
  assert.deepEqual(organsOf({ eyes, bladder }), [one, other]);
  assert.deepEqual([organsOf({ eyes: null }), organsOf(null), organsOf({ bladder })], [[], [], [other]]);
});
