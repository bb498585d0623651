// The eyes of a larva: where a view shows them, and their numbers in words. Pure.

import { grouped, micrometres, nanolitres } from "./format.ts";
import { project, type Projection } from "./projection.ts";
import type { Measured, StoredEye } from "./status.ts";

/** An ellipse in a picture, px. `angle`: of the first half axis from the columns' direction, rad. */
export interface Ellipse {
  u: number;
  v: number;
  half: [number, number];
  angle: number;
}

/** The image of an eye; null where it is not in front of the camera. Within an eye the projection is as good as linear. */
export function ellipseOf({ centre_um, spread_um2 }: StoredEye, p: Projection): Ellipse | null {
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

const REASONS: Record<NonNullable<NonNullable<Measured["eyes"]>["reason"]>, string> = {
  few_views: "too few views show the larva from different sides",
  not_dark: "no part near an end is as dark and as thick as an eye",
  only_one: "only one part is as dark and as thick as an eye, or both eyes touch",
  not_ellipsoids: "the dark parts do not fit two ellipsoids",
};

/** `Eyes: left 9.4 ± 0.5 nL, right 9.3 ± 0.5 nL, 310 ± 5 µm apart.` Empty where none were looked for. */
export function eyesWords(eyes: Measured["eyes"]): string {
  if (!eyes) return "";
  const one = ({ side, volume_um3, volume_sd_um3 }: StoredEye) =>
    `${side ? `${side} ` : ""}${nanolitres(volume_um3, volume_sd_um3)}`;
  const found = eyes.eyes.map(one).join(", ");
  const why = eyes.reason ? REASONS[eyes.reason] : "";
  if (found === "") return why === "" ? "" : `Eyes: not found, because ${why}.`;
  const apart =
    eyes.distance_um == null ? "" : `, ${grouped(eyes.distance_um)} ± ${micrometres(eyes.distance_sd_um ?? 0)} apart`;
  return `Eyes (± 1 SD): ${found}${apart}.${why === "" ? "" : ` One was not found: ${why}.`}`;
}
