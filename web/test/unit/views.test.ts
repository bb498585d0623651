import assert from "node:assert/strict";
import { test } from "node:test";
import { cameraOfView, project, projectionOf, scaled } from "../../src/projection.ts";
import { edgeOf, silhouetteOf } from "../../src/silhouette.ts";
import { standingsOf, standingWords } from "../../src/standing.ts";
import type { Measured, StoredCamera, StoredViewRecord } from "../../src/status.ts";
import { pictureOf, stripWords, viewNumber, viewWords } from "../../src/views.ts";
import { areaPlace, noVolumePlace } from "../support/references.ts";

const psi: StoredCamera = { f: 60_000, kx: 1 / 5.5, ky: 1 / 5.5, ux: 511.5, uy: 511.5, width: 1024, height: 1024 };

function near(found: [number, number] | null, u: number, v: number): void {
  assert.ok(found && Math.hypot(found[0] - u, found[1] - v) < 1e-6, `${found} is not ${u}, ${v}`);
}

test("the signs of the camera are those of docs/calibration.md", () => {
  near(project(projectionOf(psi, 1), 55, 0, 0), 521.5, 511.5);
  const at = (camera: StoredCamera, omega: number, x: [number, number, number]) =>
    project(projectionOf(camera, omega), ...x)!;
  assert.ok(at(psi, 0.1, [0, 0, -275])[1] > at(psi, 0, [0, 0, -275])[1], "positive omega moves the near wall down");
  assert.ok(at({ ...psi, gamma: 0.01 }, 0, [1000, 0, 0])[1] > 511.5, "positive gamma lowers the +x end");
  const depth = (alpha: number) => {
    const [, , w] = projectionOf({ ...psi, alpha }, 0);
    return w![0] * 1000 + w![3];
  };
  assert.ok(depth(0.01) < depth(0), "positive alpha brings the +x end nearer");
  assert.equal(project(projectionOf(psi, 0), 0, 0, -60_001), null, "behind the camera");
});

test("every parameter has its place: the product of the matrices, computed apart", () => {
  const camera = { ...psi, kx: 0.18, ky: 0.19, ux: 500, uy: 510, s: 0.001, alpha: 0.02, gamma: -0.03, phi: 1.5 };
  near(project(projectionOf(camera, 0.7), 800, -150, 230), 642.9797437437467, 1263.007168029302);
});

test("glass turns the rays: points where traced rays see them", () => {
  const glass = { bore_radius_um: 300, outer_radius_um: 425, inside: 1.333, glass: 1.474, outside: 1.333 };
  const camera = { ...psi, f: 1e8, kx: 1, ky: 1, ux: 0, uy: 0, glass };
  const at = (y: number, z: number, omega: number) => project(projectionOf(camera, omega), 0, y, z)![1];
  assert.ok(Math.abs(at(-150, 230, 0.7) + 256.59084) < 0.01);
  assert.ok(Math.abs(at(200, -180, 0.4) - 260.2551) < 0.01);
  const half = project(scaled(projectionOf(camera, 0), 0.5), 0, 250, 20)!;
  assert.ok(Math.abs(half[1] + 0.25 - 248.28569 / 2) < 0.01, "in a smaller picture too");
});

test("a smaller picture has its pixels where the larger one has them", () => {
  const p = projectionOf(psi, 0.4);
  const [u, v] = project(p, 700, 120, -80)!;
  // The corner of the picture stays: u + 0.5 is scaled.
  near(project(scaled(p, 0.25), 700, 120, -80), (u + 0.5) / 4 - 0.5, (v + 0.5) / 4 - 0.5);
});

const view = (index: number, omega: number, change: Partial<StoredViewRecord> = {}): StoredViewRecord => ({
  ...{ index, omega, used: true, reason: null, dy_px: 0, residual_px: 0.2 },
  ...change,
});

test("a view is seen by the calibrated camera: shift, angle, and the rig's camera without a calibration", () => {
  const views = [view(0, 0, { used: false, reason: "dust", dy_px: null }), view(1, 0.3, { dy_px: 2 }), view(2, 0.6)];
  const measured: Measured = { calibration: { psi: { ...psi, uy: 500 }, rho: 1.1 }, views };
  const recording = { rig: { camera: psi } };
  const x = [100, 50, -200] as const;
  const at = (m: Measured | null, i: number) => project(cameraOfView(recording, m, i)!.projection, ...x);
  near(at(measured, 1), ...project(projectionOf({ ...psi, uy: 502 }, 0.3), ...x)!);
  near(at(measured, 2), ...project(projectionOf({ ...psi, uy: 500 }, 0.3 + 1.1 * 0.3), ...x)!);
  near(at({ calibration: null, views }, 2), ...project(projectionOf(psi, 0.6), ...x)!);
  assert.equal(cameraOfView(recording, measured, 7), null);
  assert.equal(cameraOfView(recording, null, 1), null);
});

test("the silhouette of two triangles has no gap, and its edge is two pixels wide", () => {
  // A camera that shows world (x, y) as pixel (x, y).
  const plain = [
    [1, 0, 0, 0],
    [0, 1, 0, 0],
    [0, 0, 0, 1],
  ] as const;
  const positions = [1.5, 1.5, 1, 6.5, 1.5, 1, 6.5, 4.5, 1, 1.5, 4.5, 1];
  const mask = silhouetteOf({ positions, corners: [0, 1, 2, 0, 2, 3] }, plain, 9, 7);
  const inside = (u: number, v: number) => mask[v * 9 + u] === 1;
  for (let v = 0; v < 7; v += 1)
    for (let u = 0; u < 9; u += 1) assert.equal(inside(u, v), u >= 2 && u <= 6 && v >= 2 && v <= 4, `${u} ${v}`);
  const edge = edgeOf(inside, 9, 7);
  const row = (v: number) => [...edge.subarray(v * 9, v * 9 + 9)].join("");
  assert.equal(row(3), "011000110");
  assert.equal(row(0), "000000000");
});

test("links lead to pictures of the page's size, and to the number of their view", () => {
  assert.equal(viewNumber("/v1/runs/r/specimens/A01/views/12.png?attempt=2"), 12);
  assert.equal(viewNumber("/v1/runs/r/specimens/A01/views/detection.png"), null);
  assert.equal(pictureOf("/v1/x/views/3.png"), "/v1/x/views/3.jpg");
  assert.equal(pictureOf("/v1/x/views/3.png?attempt=1", 320), "/v1/x/views/3.jpg?attempt=1&width=320");
  assert.equal(pictureOf("/v1/x/views/3.png", 320), "/v1/x/views/3.jpg?width=320");
});

test("a view says its distance, or why it does not count; the strip names the worst", () => {
  assert.equal(viewWords(view(3, 1)), "0.20 px");
  assert.equal(viewWords(view(3, 1, { used: false, reason: "not_seen" })), "left out: not seen");
  assert.equal(viewWords(undefined), "no numbers");
  const all = [view(0, 0), view(1, 1, { residual_px: 0.1 }), view(2, 2, { residual_px: 0.9 })];
  assert.match(stripWords(all), /^3 views, all of them count\. .* 0\.20 px \(median\), 0\.90 px in view 3\.$/);
  assert.match(stripWords([...all, view(3, 3, { used: false })]), /^4 views, 1 left out\./);
  assert.equal(stripWords([], 7), "7 views, not measured.", "a turn that was cut short");
});

test("a larva stands where its estimator has references, and says its share in words", () => {
  const estimate = (estimator: string, z: number) => ({
    ...{ estimator, volume: noVolumePlace, area: areaPlace(z, 22.6) },
  });
  const measured = { views: [], reference: { estimates: [estimate("voxel", 2), estimate("support", -0.8)] } };
  const [area, ...more] = standingsOf(measured, "support");
  assert.deepEqual([area!.quantity, area!.z, area!.mean, more.length], ["Area", -0.8, 3.2, 0]);
  const [other] = standingsOf(measured, "field");
  assert.equal(other!.z, 2, "the first, where the estimator has none");
  assert.match(standingWords(other!), /^Area [\d.]+ mm² by the voxels, as the references were measured: 2\.0 SD above/);
  assert.equal(
    standingWords(area!),
    "Area 3.080 mm²: 0.8 SD below the mean of 12 larvae (fixed, 3 dpf). 23 % of such larvae are smaller.",
  );
  assert.match(standingWords({ ...area!, percentile: 99.6 }), / More than 99 % of such larvae are smaller\.$/);
  assert.match(standingWords({ ...area!, percentile: 0.4 }), / Less than 1 % of such larvae are smaller\.$/);
  assert.deepEqual(standingsOf(null, null), []);
});
