// The swim bladder in words.

import assert from "node:assert/strict";
import { test } from "node:test";
import { bladderWords } from "../../src/bladder.ts";
import type { StoredLobe } from "../../src/contract.ts";

const lobe: StoredLobe = {
  volume_um3: 6.71e6,
  volume_sd_um3: 0.37e6,
  centre_um: [1000, 50, 0],
  half_axes_um: [185, 97, 88],
  spread_um2: [185 ** 2, 97 ** 2, 88 ** 2, 0, 0, 0],
  residual_px: 0.2,
};

test("a swim bladder is said with its volume and length, or why there are none", () => {
  const inflated = {
    state: "inflated" as const,
    reason: null,
    lobes: [lobe],
    volume_um3: 6.71e6,
    volume_sd_um3: 0.37e6,
    length_um: 370.4,
    length_sd_um: 4.1,
  };
  assert.match(bladderWords(inflated), /^Swim bladder \(± 1 SD\): 6\.71 ± 0\.37.nL, 370 ± 4.µm long\.$/u);
  assert.match(bladderWords({ ...inflated, lobes: [lobe, lobe] }), / long, two lobes\.$/);
  const none = { lobes: [], volume_um3: null, volume_sd_um3: null, length_um: null, length_sd_um: null };
  assert.match(
    bladderWords({ ...none, state: "not_inflated", reason: "no_gas" }),
    /^Swim bladder: without gas, because nothing in the trunk/,
  );
  assert.match(
    bladderWords({ ...none, state: "undecided", reason: "few_views" }),
    /^Swim bladder: not decided, because too few views/,
  );
  assert.match(
    bladderWords({ ...none, state: "undecided", reason: "part_unseen" }),
    /^Swim bladder: not decided, because part of the larva was not measured/,
  );
  assert.equal(bladderWords(null), "");
});
