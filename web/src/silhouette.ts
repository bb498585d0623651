// The silhouette of a mesh in a view. Pure.

import type { Projection } from "./projection.ts";

/** A mesh as three.js keeps it: coordinates in threes, and the corners of triangles in threes. */
export interface Triangles {
  positions: ArrayLike<number>;
  corners: ArrayLike<number>;
}

/** 1 where the centre of a pixel lies in the image of a triangle. Triangles with a corner behind the camera are left out. */
export function silhouetteOf(
  { positions, corners }: Triangles,
  projection: Projection,
  width: number,
  height: number,
): Uint8Array {
  const [a, b, c] = [projection[0]!, projection[1]!, projection[2]!];
  const { apparent } = projection;
  const count = positions.length / 3;
  const [us, vs] = [new Float64Array(count), new Float64Array(count)];
  for (let i = 0, at = 0; i < count; i += 1, at += 3) {
    const x = positions[at]!;
    let [y, z] = [positions[at + 1]!, positions[at + 2]!];
    if (apparent) [y, z] = apparent(y, z);
    const w = c[0] * x + c[1] * y + c[2] * z + c[3];
    us[i] = w > 0 ? (a[0] * x + a[1] * y + a[2] * z + a[3]) / w : NaN;
    vs[i] = w > 0 ? (b[0] * x + b[1] * y + b[2] * z + b[3]) / w : NaN;
  }
  const mask = new Uint8Array(width * height);
  for (let t = 0; t + 2 < corners.length; t += 3) {
    const [i, j, k] = [corners[t]!, corners[t + 1]!, corners[t + 2]!];
    fill(mask, width, height, us[i]!, vs[i]!, us[j]!, vs[j]!, us[k]!, vs[k]!);
  }
  return mask;
}

/**
 * Fills a triangle row by row between the crossings of its sides. Both ends belong to the triangle, so neighbours leave no gap. Written
 * without arrays, because it runs for half a million triangles when a specimen is opened.
 */
function fill(
  mask: Uint8Array,
  width: number,
  height: number,
  u0: number,
  v0: number,
  u1: number,
  v1: number,
  u2: number,
  v2: number,
): void {
  const first = Math.max(0, Math.ceil(Math.min(v0, v1, v2)));
  const last = Math.min(height - 1, Math.floor(Math.max(v0, v1, v2)));
  for (let y = first; y <= last; y += 1) {
    let left = Infinity;
    let right = -Infinity;
    for (let side = 0; side < 3; side += 1) {
      const [a, b] = side === 0 ? [u0, v0] : side === 1 ? [u1, v1] : [u2, v2];
      const [c, d] = side === 0 ? [u1, v1] : side === 1 ? [u2, v2] : [u0, v0];
      if (y < Math.min(b, d) || y > Math.max(b, d)) continue;
      if (b === d) {
        // A side that lies in the row has no crossing: both its ends count.
        left = Math.min(left, a, c);
        right = Math.max(right, a, c);
      } else {
        const u = a + ((y - b) / (d - b)) * (c - a);
        left = Math.min(left, u);
        right = Math.max(right, u);
      }
    }
    const from = Math.max(0, Math.ceil(left));
    const to = Math.min(width - 1, Math.floor(right));
    if (from <= to) mask.fill(1, y * width + from, y * width + to + 1);
  }
}

/** The pixels on both sides of the border of a mask, and those diagonally beside it: a line of two pixels. */
export function edgeOf(inside: (u: number, v: number) => boolean, width: number, height: number): Uint8Array {
  const edge = new Uint8Array(width * height);
  for (let v = 0; v < height; v += 1) {
    for (let u = 0; u < width; u += 1) {
      const here = inside(u, v);
      const right = (u + 1 < width && inside(u + 1, v)) !== here;
      const below = (v + 1 < height && inside(u, v + 1)) !== here;
      if (!right && !below) continue;
      edge[v * width + u] = 1;
      if (u + 1 < width) edge[v * width + u + 1] = 1;
      if (v + 1 < height) edge[(v + 1) * width + u] = 1;
    }
  }
  return edge;
}
