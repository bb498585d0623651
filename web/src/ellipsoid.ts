// Ellipsoids of a larva's organs: where a view shows them. Pure.

import { project, type Projection } from "./projection.ts";
import type { Measured, StoredEye } from "./status.ts";

/** An ellipse in a picture, px. `angle`: of the first half axis from the columns' direction, rad. */
export interface Ellipse {
  u: number;
  v: number;
  half: [number, number];
  angle: number;
}

/** What an organ's ellipsoid is drawn from. */
export type Ellipsoid = Pick<StoredEye, "centre_um" | "spread_um2">;

/** Its image; null where it is not in front of the camera. Within an organ the projection is as good as linear. */
export function ellipseOf({ centre_um, spread_um2 }: Ellipsoid, p: Projection): Ellipse | null {
  const [x, y, z] = centre_um as [number, number, number];
  const at = project(p, x, y, z);
  const ahead = [project(p, x + 1, y, z), project(p, x, y + 1, z), project(p, x, y, z + 1)];
  if (at === null || ahead.some((one) => one === null)) return null;
  // Pixels per um along x, y and z.
  const [a, b] = [0, 1].map((k) => ahead.map((one) => one![k]! - at[k]!)) as [number[], number[]];
  const [xx, yy, zz, xy, xz, yz] = spread_um2 as [number, number, number, number, number, number];
  const spread = [
    [xx, xy, xz],
    [xy, yy, yz],
    [xz, yz, zz],
  ];
  const form = (l: number[], r: number[]) =>
    l.reduce((sum, li, i) => sum + li * r.reduce((s, rj, j) => s + spread[i]![j]! * rj, 0), 0);
  const [uu, vv, uv] = [form(a, a), form(b, b), form(a, b)];
  const [middle, apart] = [(uu + vv) / 2, Math.hypot((uu - vv) / 2, uv)];
  const half = [middle + apart, middle - apart].map((e) => Math.sqrt(Math.max(e, 0))) as [number, number];
  return { u: at[0], v: at[1], half, angle: Math.atan2(2 * uv, uu - vv) / 2 };
}

/** The ellipsoids of all organs that were found. */
export function organsOf(measured: Pick<Measured, "eyes" | "bladder"> | null | undefined): Ellipsoid[] {
  return [...(measured?.eyes?.eyes ?? []), ...(measured?.bladder?.lobes ?? [])];
}
