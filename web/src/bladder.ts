// The swim bladder of a larva in words. Pure.

import { grouped, micrometres, nanolitres } from "./format.ts";
import type { Measured } from "./status.ts";

const REASONS: Record<NonNullable<NonNullable<Measured["bladder"]>["reason"]>, string> = {
  few_views: "too few views show the larva from different sides",
  no_head: "neither the eyes nor the shape tell the head from the tail",
  opaque: "no light passes the trunk, so that gas in it would not be seen",
  no_gas: "nothing in the trunk has the dark rim and the bright middle of gas",
  part_unseen: "part of the larva was not measured, and may have the gas",
  unclear: "something in the trunk is a little like gas, and not enough to decide",
};

/** `Swim bladder (± 1 SD): 6.71 ± 0.37 nL, 370 ± 4 µm long.` Empty where none was looked for. */
export function bladderWords(bladder: Measured["bladder"]): string {
  if (!bladder) return "";
  const { volume_um3, volume_sd_um3, length_um, length_sd_um, lobes, state } = bladder;
  if (volume_um3 != null) {
    const long = length_um == null ? "" : `, ${grouped(length_um)} ± ${micrometres(length_sd_um ?? 0)} long`;
    const two = lobes.length > 1 ? ", two lobes" : "";
    return `Swim bladder (± 1 SD): ${nanolitres(volume_um3, volume_sd_um3)}${long}${two}.`;
  }
  const why = bladder.reason ? `, because ${REASONS[bladder.reason]}` : "";
  return state === "not_inflated" ? `Swim bladder: without gas${why}.` : `Swim bladder: not decided${why}.`;
}
