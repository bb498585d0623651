// Explains flags and reasons: what was found, and what to do about it. docs/quality.md describes the limits. Pure.

import { words } from "./format.ts";

const FLAGS: Record<string, string> = {
  area_off_references: "its area is far from that of larvae of its age: look at the frames and the plate map",
  axis_off_bore: "its axis is not in the middle of the glass: look whether the glass and the specimen turn together",
  bad_view: "a view did not belong and was left out",
  bead_gate: "no passed and fresh measurement of beads stands behind it",
  blur_mismatch: "the frames are blurred otherwise than configured: look at the focus",
  calibration_gate: "the calibration of its turn was not used: it made the model smaller",
  calibration_off: "the capillary lies elsewhere than configured: look how it is mounted",
  clipped_left: "it goes on beyond the left of the picture",
  clipped_right: "it goes on beyond the right of the picture",
  closure_undecided:
    "its last view cannot tell whether it moved during the turn: look at the frames, or measure it again",
  dead_looking: "it looks dead",
  fins_unseen:
    "the views do not show all of its fins, so its volume may be up to 5 % too small: look at light and focus",
  few_views: "too few views count, or none from one side",
  mirrored_views: "some of its pictures have left and right exchanged: this is no volume",
  missing_views: "pictures of some views are missing: its numbers come from the others",
  moved: "it moved during the turn: measure it again",
  no_closure: "no view closed the turn, so nobody knows whether it moved",
  nonconvex: "it is bent or hollow in places: there the voxels are trusted",
  outside_box: "it reaches out of the box that is measured",
  overlap: "a view does not fit the model: look at its frames",
  repeated_views: "a picture stands for two angles: this is no volume",
  residual: "the views do not agree: look at focus and vibration, or it twitched",
  rotation_suspect: "it did not turn while the motor did: look at the coupling, and measure it again",
  specimen_ends_differ: "its ends are not at the same places in all pictures: this is no volume",
  uncalibrated: "its turn could not be calibrated",
  uncertain: "its volume is known far worse than others are: look at its frames, or measure it again with more views",
  unusable_views: "many views could not be used: look at light, focus and bubbles",
  views_disagree: "pictures fit the others at another angle, upside down or not at all: this is no volume",
  volume_off_references: "its volume is far from that of larvae of its age: look at the frames and the plate map",
  wrong_steps: "the axis turned another angle than it said: look at its coupling",
};

const REASONS: Record<string, string> = {
  blocked: "the capillary lets no light through",
  bubble: "an air bubble",
  clipped: "it goes on beyond the picture",
  debris: "debris",
  empty: "the capillary is empty",
  no_pictures: "no picture of it was stored",
  two: "two larvae",
};

export function flagWords(flag: string): string {
  return FLAGS[flag] ?? words(flag);
}

/** Why a well has no number. The reason of a failure is a sentence already, in which paths and commands are kept unchanged. */
export function reasonWords(reason: string): string {
  return REASONS[reason] ?? (/^[a-z_]+$/.test(reason) ? words(reason) : reason);
}
