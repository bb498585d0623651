// Where a point of the model lies in a frame: the calibrated camera of the specimen. Pure.
//
//   x~ = K [ Ry(alpha) Rz(gamma) Rx(omega) X + f (0, cos phi, sin phi) ]      K = [ f kx  s  ux ; 0  f ky  uy ; 0  0  1 ]
//
// World in um, x along the capillary, y down, z away from the camera. Pixel centres are at integers. docs/calibration.md has the geometry,
// and the daemon's own implementation has the same definition.

import { apparentIn, type Apparent } from "./glass.ts";
import type { Measured, Recorded, StoredCamera } from "./status.ts";

/** Three rows of four: `(u w, v w, w)` of a point `(x, y, z, 1)`. Through glass, of the point where it seems to be. */
export type Projection = readonly (readonly [number, number, number, number])[] & {
  readonly apparent?: Apparent | null;
};

export function projectionOf(psi: StoredCamera, omega: number): Projection {
  const { f, kx, ky, ux, uy, s = 0, alpha = 0, gamma = 0, phi = Math.PI / 2 } = psi;
  const k = [
    [f * kx, s, ux],
    [0, f * ky, uy],
    [0, 0, 1],
  ];
  const [ca, sa, cg, sg, co, so] = [alpha, gamma, omega].flatMap((a) => [Math.cos(a), Math.sin(a)]) as [
    number,
    number,
    number,
    number,
    number,
    number,
  ];
  // Ry(alpha) Rz(gamma) Rx(omega), then the place of the axis.
  const r = [
    [ca * cg, -ca * sg * co + sa * so, ca * sg * so + sa * co, 0],
    [sg, cg * co, -cg * so, f * Math.cos(phi)],
    [-sa * cg, sa * sg * co + ca * so, -sa * sg * so + ca * co, f * Math.sin(phi)],
  ];
  const rows = k.map((row) => [0, 1, 2, 3].map((j) => row.reduce((sum, a, i) => sum + a * r[i]![j]!, 0)));
  return Object.assign(rows, { apparent: apparentIn(psi, omega) }) as unknown as Projection;
}

/** The projection into a picture that is `factor` times as large. */
export function scaled(p: Projection, factor: number): Projection {
  const [u, v, w] = p;
  // Pixel centres are at integers, so the corner of the picture is at -0.5.
  const shift = (factor - 1) / 2;
  const row = (a: Projection[number]) => a.map((x, j) => factor * x + shift * w![j]!);
  return Object.assign([row(u!), row(v!), w!], { apparent: p.apparent }) as unknown as Projection;
}

/** The column and row of a point; null if it is not in front of the camera. */
export function project(p: Projection, x: number, y: number, z: number): [number, number] | null {
  const [ya, za] = p.apparent?.(y, z) ?? [y, z];
  const [u, v, w] = p.map((r) => r[0] * x + r[1] * ya + r[2] * za + r[3]) as [number, number, number];
  return w > 0 ? [u / w, v / w] : null;
}

/** A view of a specimen: the camera and the projection with which the model was made; null if the record does not have them. */
export function cameraOfView(
  recording: Recorded,
  measured: Measured | null,
  view: number,
): { projection: Projection; width: number; height: number } | null {
  const record = measured?.views.find(({ index }) => index === view);
  const calibration = measured?.calibration ?? null;
  const psi = calibration?.psi ?? recording.rig.camera;
  if (record === undefined) return null;
  let { omega } = record;
  let uy = psi.uy;
  if (calibration !== null) {
    // The angles are corrected around the used view that is nearest to 0.
    const used = (measured?.views ?? []).filter((v) => typeof v.dy_px === "number").map((v) => v.omega);
    const first = used.reduce((best, one) => (Math.abs(one) < Math.abs(best) ? one : best), used[0] ?? 0);
    omega = first + calibration.rho * (omega - first);
    uy += record.dy_px ?? 0;
  }
  return { projection: projectionOf({ ...psi, uy }, omega), width: psi.width, height: psi.height };
}
