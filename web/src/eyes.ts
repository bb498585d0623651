// The eyes of a larva in words. Pure.

import { grouped, micrometres, nanolitres } from "./format.ts";
import type { Measured, StoredEye } from "./status.ts";

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
