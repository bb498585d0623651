import assert from "node:assert/strict";
import { test } from "node:test";
import {
  colourAt,
  colourOf,
  contrast,
  isBeyond,
  controlsOf,
  rangeOf,
  scaledWells,
  valueOf,
  valueWords,
  whyNone,
} from "../../src/scale.ts";
import { placed, well } from "../support/statuses.ts";

const measured = (name: string, volume_um3: number) => well(name, { outcome: "succeeded", volume_um3 });

test("the distance from a plate's controls is in their standard deviations", () => {
  const wells = [measured("A01", 240e6), measured("A02", 250e6), measured("A03", 260e6), measured("B01", 270e6)];
  const plan = ["A01", "A02", "A03"].map((name) => ({ well: name, control: "negative" as const }));
  const controls = controlsOf(wells, plan);
  assert.deepEqual(controls, { mean: 250e6, sd: 10e6, n: 3, leftOut: [] });
  assert.equal(valueOf(wells[3]!, "controls", controls), 2);
  assert.equal(valueWords(2, "controls"), "+2.0 SD");
  // As in the statistics of the daemon: what is doubtful, a bound or left out by a person does not count. A remark does.
  for (const flag of ["moved", "clipped_left", "excluded"]) {
    const doubted = [...wells, well("B02", { outcome: "succeeded", volume_um3: 900e6, flags: [flag] })];
    const withDoubted = [...plan, { well: "B02", control: "negative" as const }];
    assert.deepEqual(controlsOf(doubted, withDoubted), { mean: 250e6, sd: 10e6, n: 3, leftOut: ["B02"] }, flag);
  }
  const looks = [...wells, well("B02", { outcome: "succeeded", volume_um3: 250e6, flags: ["dead_looking"] })];
  assert.equal(controlsOf(looks, [...plan, { well: "B02", control: "negative" }])?.n, 4);
  assert.equal(controlsOf(wells, plan.slice(1)), null, "two are too few");
  const positive = plan.map((w) => ({ ...w, control: "positive" as const }));
  assert.equal(controlsOf(wells, positive), null);
  const alike = ["A01", "A02", "A03"].map((name) => measured(name, 1e6));
  assert.equal(controlsOf(alike, plan), null, "without a spread there is no distance");
});

test("the ends of a scale: the least and the most volume, or three standard deviations", () => {
  assert.deepEqual(rangeOf([243.1, 200, 251], "volume"), { least: 200, most: 251 });
  // One of 24 wells is far off: the others keep their colours, and this one is marked.
  const alike = Array.from({ length: 23 }, (_, i) => 240 + i);
  const robust = rangeOf([...alike, 900], "volume")!;
  assert.ok(robust.least < 241 && robust.most > 262 && robust.most < 290, JSON.stringify(robust));
  assert.deepEqual(
    [900, 262, 240].map((value) => isBeyond(value, robust)),
    [true, false, false],
  );
  assert.equal(isBeyond(7, rangeOf([7, 7], "volume")!), false);
  // Of 100 wells two at each end are beyond the scale.
  const hundred = Array.from({ length: 100 }, (_, i) => i);
  assert.deepEqual(rangeOf(hundred, "area"), { least: 2, most: 97 });
  assert.deepEqual(rangeOf([0.5], "z_volume"), { least: -3, most: 3 });
  assert.equal(rangeOf([], "volume"), null);
  const range = { least: -3, most: 3 };
  assert.deepEqual(colourOf(-9, range, "z_volume"), colourAt(0, "z_volume"), "beyond the end");
  assert.deepEqual(colourOf(7, { least: 7, most: 7 }, "volume"), colourAt(0.5, "volume"), "one number alone");
});

test("a number that is a bound has no colour and is no control", () => {
  const cut = well("A01", { outcome: "succeeded", volume_um3: 65e6, area_um2: 1e6, flags: ["clipped_left"] });
  for (const by of ["volume", "area", "z_volume", "controls"] as const)
    assert.equal(valueOf(cut, by, { mean: 70e6, sd: 1e6, n: 3, leftOut: [] }), null, by);
  assert.equal(valueOf(cut, "flags", null), 1);
  const plan = ["A01", "A02", "A03", "A04"].map((name) => ({ well: name, control: "negative" as const }));
  const wells = [cut, measured("A02", 240e6), measured("A03", 250e6), measured("A04", 260e6)];
  assert.equal(controlsOf(wells, plan)!.n, 3);
});

test("beads among larvae have no part in the scale of volumes, and beads alone have one", () => {
  const bead = well("A02", { specimen: "bead", outcome: "succeeded", volume_um3: 65e6, residual_px: 0.2 });
  const wells = [measured("A01", 240e6), bead];
  const names = (by: Parameters<typeof scaledWells>[1], of = wells) => scaledWells(of, by).map((w) => w.well);
  assert.deepEqual([names("volume"), names("area"), names("residual")], [["A01"], ["A01"], ["A01", "A02"]]);
  assert.deepEqual(names("volume", [bead]), ["A02"]);
});

test("quality colours a well by its flags or its residual", () => {
  const flagged = well("A01", { outcome: "succeeded", flags: ["residual", "drift"], residual_px: 0.31 });
  assert.deepEqual([valueOf(flagged, "flags", null), valueOf(flagged, "residual", null)], [2, 0.31]);
  assert.equal(valueOf(well("A02"), "flags", null), null, "a well that is not measured is not without flags");
  assert.deepEqual(
    [0, 1, 2].map((n) => valueWords(n, "flags")),
    ["no flag", "1 flag", "2 flags"],
  );
  assert.equal(valueWords(0.31, "residual"), "0.31 px");
  assert.deepEqual(rangeOf([0, 0], "flags"), { least: 0, most: 1 });
  assert.deepEqual(rangeOf([0.2, 0.9], "residual"), { least: 0.2, most: 0.9 });
});

test("a plate without colours says why", () => {
  const larva = well("A01", { outcome: "succeeded", volume_um3: 1, reference: placed });
  assert.equal(whyNone([larva], "z_volume", []), "No colours: no reference of 3 dpf.");
  assert.equal(whyNone([well("A01")], "z_volume", []), "No colours yet: no well is measured.");
  assert.match(
    whyNone([{ ...larva, reference: null }], "z_area", []),
    /^No colours: no measured well is a larva of known age/,
  );
  assert.match(whyNone([larva], "controls", []), /^No colours: statistics can use fewer than 3 negative controls/);
  const moved = well("A02", { volume_um3: 1, flags: ["moved"] });
  assert.match(whyNone([moved], "controls", [{ well: "A02", control: "negative" }]), / Left out: A02\.$/);
});

test("signs can be read on every colour of both scales", () => {
  for (const by of ["volume", "z_volume", "flags"] as const) {
    for (let share = 0; share <= 1; share += 0.01) {
      const { background, ink } = colourAt(share, by);
      const rgb = background.match(/\d+/g)!.map(Number);
      assert.ok(contrast(rgb, ink === "#fff" ? 1 : 0) >= 4.5, `${by} ${share}: ${ink} on ${background}`);
    }
  }
});
