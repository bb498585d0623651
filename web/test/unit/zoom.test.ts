import assert from "node:assert/strict";
import { test } from "node:test";
import { about, kept, WHOLE } from "../../src/zoom.ts";

test("the point under the pointer stays where it is, and the picture never leaves its box", () => {
  const [width, height] = [900, 300];
  const near = about(WHOLE, 4, 300, 100, width, height);
  assert.equal(near.scale, 4);
  // The point of the picture that was at (300, 100) is there still.
  assert.deepEqual([near.x + 4 * 300, near.y + 4 * 100], [300, 100]);
  assert.deepEqual(about(near, 1 / 8, 300, 100, width, height), { scale: 1, x: 0, y: 0 });
  assert.deepEqual(kept({ scale: 2, x: 50, y: -1e4 }, width, height), { scale: 2, x: 0, y: -300 });
  assert.equal(about(WHOLE, 1e6, 0, 0, width, height).scale, 16);
});
