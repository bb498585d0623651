// How the glass tube around the specimen turns rays. Pure. docs/calibration.md has the formula.

import type { StoredCamera } from "./status.ts";

/** Where a point (y, z) of the capillary would lie if it were seen there without glass, um. */
export type Apparent = (y: number, z: number) => [number, number];

/** Share of the bore beyond which the angle no longer grows. */
const REACH = 0.998;
const TABLE_STEPS = 2048;

/** The same for a view of a camera; null where nothing turns the rays. */
export function apparentIn({ glass, f, phi = Math.PI / 2 }: StoredCamera, omega: number): Apparent | null {
  if (!glass) return null;
  const { bore_radius_um: bore, outer_radius_um: outer, inside, glass: index, outside } = glass;
  const reach = REACH * Math.min(bore, (outer * outside) / inside);
  const sine = (b: number, n: number, radius: number) => Math.asin((b * inside) / (n * radius));
  const exact = (b: number) =>
    sine(b, inside, bore) - sine(b, index, bore) + sine(b, index, outer) - sine(b, outside, outer);
  const per = TABLE_STEPS / (2 * reach);
  const table = Float64Array.from({ length: TABLE_STEPS + 2 }, (_, i) => exact(Math.min(i / per - reach, reach)));
  // The angle, and how much it grows per um.
  const turn = (b: number): [number, number] => {
    const at = (Math.min(Math.max(b, -reach), reach) + reach) * per;
    const step = Math.min(Math.floor(at), TABLE_STEPS);
    const rise = table[step + 1]! - table[step]!;
    return [table[step]! + (at - step) * rise, rise * per];
  };
  const [cos, sin] = [Math.cos(omega), Math.sin(omega)];
  const [from, far] = [f * Math.cos(phi), f * Math.sin(phi)];
  return (y, z) => {
    const [across, depth] = [y * cos - z * sin, y * sin + z * cos];
    const radius = Math.hypot(across, depth);
    const within = Math.min(reach / radius, 1);
    let [low, high] = [-radius * within, radius * within];
    let b = across * within;
    for (let i = 0; i < 40; i += 1) {
      const [eps, rise] = turn(b);
      const [c, s] = [Math.cos(eps), Math.sin(eps)];
      const [seen, beyond] = [within * (across * c - depth * s), within * (across * s + depth * c)];
      const [right, away] = [seen + from, beyond + far];
      const off = (seen * away - beyond * right) / Math.hypot(right, away) - b;
      if (Math.abs(off) < 1e-6) break;
      if (off > 0) low = b;
      else high = b;
      const next = b + off / (1 + beyond * rise);
      b = next > low && next < high ? next : (low + high) / 2;
    }
    const [c, s] = [Math.cos(turn(b)[0]), Math.sin(turn(b)[0])];
    return [y * c - z * s, y * s + z * c];
  };
}
