import assert from "node:assert/strict";
import { test } from "node:test";
import { colourAt, colourOf, contrast, controlsOf, rangeOf, valueOf, valueWords } from "../../src/scale.ts";
import { well } from "../support/statuses.ts";

const measured = (name: string, volume_um3: number) => well(name, { outcome: "succeeded", volume_um3 });

test("the distance from a plate's controls is in their standard deviations", () => {
  const wells = [measured("A01", 240e6), measured("A02", 250e6), measured("A03", 260e6), measured("B01", 270e6)];
  const plan = ["A01", "A02", "A03"].map((name) => ({ well: name, control: "negative" as const }));
  const controls = controlsOf(wells, plan);
  assert.deepEqual(controls, { mean: 250e6, sd: 10e6, n: 3 });
  assert.equal(valueOf(wells[3]!, "controls", controls), 2);
  assert.equal(valueWords(2, "controls"), "+2.0 SD");
  assert.equal(controlsOf(wells, plan.slice(1)), null, "two are too few");
  const positive = plan.map((w) => ({ ...w, control: "positive" as const }));
  assert.equal(controlsOf(wells, positive), null);
  const alike = ["A01", "A02", "A03"].map((name) => measured(name, 1e6));
  assert.equal(controlsOf(alike, plan), null, "without a spread there is no distance");
});

test("the ends of a scale: the least and the most volume, or three standard deviations", () => {
  assert.deepEqual(rangeOf([243.1, 200, 251], "volume"), { least: 200, most: 251 });
  assert.deepEqual(rangeOf([0.5], "z_volume"), { least: -3, most: 3 });
  assert.equal(rangeOf([], "volume"), null);
  const range = { least: -3, most: 3 };
  assert.deepEqual(colourOf(-9, range, "z_volume"), colourAt(0, "z_volume"), "beyond the end");
  assert.deepEqual(colourOf(7, { least: 7, most: 7 }, "volume"), colourAt(0.5, "volume"), "one number alone");
});

test("signs can be read on every colour of both scales", () => {
  for (const by of ["volume", "z_volume"] as const) {
    for (let share = 0; share <= 1; share += 0.01) {
      const { background, ink } = colourAt(share, by);
      const rgb = background.match(/\d+/g)!.map(Number);
      assert.ok(contrast(rgb, ink === "#fff" ? 1 : 0) >= 4.5, `${by} ${share}: ${ink} on ${background}`);
    }
  }
});
