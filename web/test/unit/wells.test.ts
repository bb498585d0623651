import assert from "node:assert/strict";
import { test } from "node:test";
import { coloursOf, groupsOf, markOf } from "../../src/planplate.ts";
import { templateOf } from "../../src/template.ts";
import { conditionOf, CONDITIONS, conditionsOf, formatFor, place, places, spoken, wellName } from "../../src/wells.ts";
import { placed, specimen, well } from "../support/statuses.ts";

test("names and places are each other's inverse on the largest plate", () => {
  for (let row = 0; row < 32; row += 1) {
    for (let column = 0; column < 48; column += 1) {
      assert.deepEqual(place(wellName(row, column)), { row, column });
    }
  }
  const known = { A01: [0, 0], H12: [7, 11], P24: [15, 23], Z48: [25, 47], AA01: [26, 0], AF48: [31, 47] };
  for (const [name, [row, column]] of Object.entries(known)) assert.deepEqual(place(name), { row, column }, name);
  for (const wrong of ["A1", "A00", "A49", "AG01", "BA01", "a01", "A001", ""]) assert.equal(place(wrong), null, wrong);
});

test("the plate is the one of the plan, or the smallest usual one that holds every well", () => {
  const wellsOf = (wells: readonly string[], named: number | null = null) => {
    const { rows, columns } = formatFor(wells, named);
    return rows * columns;
  };
  assert.equal(wellsOf([]), 96);
  assert.equal(wellsOf(["A01", "H12"]), 96);
  assert.equal(wellsOf(["A01", "I01"]), 384);
  assert.equal(wellsOf(["A13"]), 384);
  assert.equal(wellsOf(["A25"]), 1536);
  assert.equal(wellsOf(["AA01"]), 1536);
  for (const named of [6, 12, 24, 48, 96, 384, 1536]) assert.equal(wellsOf(["A01"], named), named);
  assert.equal(wellsOf(["C01"], 6), 96, "a plan that contradicts itself shows all its wells");
  assert.equal(wellsOf(["A01"], 7), 96);
});

test("each of many treatments has a colour of its own, with a letter on it", () => {
  const colours = Array.from({ length: 60 }, (_, i) => coloursOf(i)[0]);
  assert.equal(new Set(colours).size, 60);
});

test("an empty plate map has every well of its plate, and the columns that the daemon reads", () => {
  const lines = templateOf(24).split("\r\n");
  assert.equal(
    lines[0],
    "well,specimen,dpf,compound,concentration,concentration_unit,strain,treatment,control,replicate",
  );
  assert.deepEqual(
    [lines[1], lines[6], lines[7], lines[24], lines[25]],
    ["A01,larva,,,,,,,,", "A06,larva,,,,,,,,", "B01,larva,,,,,,,,", "D06,larva,,,,,,,,", ""],
  );
  assert.equal(templateOf(1536).split("\r\n").length, 1 + 1536 + 1);
});

test("wells that are planned alike are one group, in words", () => {
  const dmso = {
    specimen: "larva" as const,
    dpf: 3,
    compound: "DMSO",
    concentration: 0.1,
    concentration_unit: "% v/v" as const,
  };
  const groups = groupsOf([
    { well: "A01", ...dmso, control: "negative" },
    { well: "A02", specimen: "bead" },
    { well: "A03", ...dmso, control: "negative", replicate: 2 },
    { well: "A04", ...dmso },
  ]);
  assert.deepEqual(
    groups.map(({ words, wells }) => [words, wells.map((w) => w.well)]),
    [
      ["larva, 3 dpf, DMSO 0.1 % v/v, negative control", ["A01", "A03"]],
      ["bead", ["A02"]],
      ["larva, 3 dpf, DMSO 0.1 % v/v", ["A04"]],
    ],
  );
});

test("every kind of a plate has a mark of its own", () => {
  assert.deepEqual([0, 25, 26, 27, 51, 52, 701, 702].map(markOf), ["a", "z", "aa", "ab", "az", "ba", "zz", "aaa"]);
  assert.equal(new Set(Array.from({ length: 1536 }, (_, i) => markOf(i))).size, 1536);
});

test("a well that was cut short and one that was never begun have another sign and other words", () => {
  const cut = well("B02", { outcome: "aborted", views: 13 });
  assert.equal(spoken(cut, conditionOf(cut, null)), "B02, larva, 3 dpf, interrupted after 13 views");
  const left = well("B02", { outcome: "aborted", views: 0 });
  assert.equal(
    spoken(left, conditionOf(left, null)),
    "B02, larva, 3 dpf, not measured: the run was ended before its first view",
  );
  assert.notEqual(CONDITIONS[conditionOf(cut, null)].sign, CONDITIONS[conditionOf(left, null)].sign);
  const old = well("B02", { outcome: "aborted" });
  assert.equal(spoken(old, conditionOf(old, null)), "B02, larva, 3 dpf, not measured: the run was ended");
  const given = well("B02", { outcome: "interrupted", views: 1 });
  assert.equal(spoken(given, conditionOf(given, null)), "B02, larva, 3 dpf, interrupted and given up after 1 view");
});

test("a well's condition follows its outcome, its flags and the specimen under way", () => {
  const own = specimen("B02", [1]);
  assert.equal(conditionOf(well("B02"), null), "pending");
  assert.equal(conditionOf(well("B02"), specimen("B03", [1])), "pending");
  assert.equal(conditionOf(well("B02"), own), "active");
  const wells = [well("B01"), well("B02"), well("B03")];
  const conditions = wells.map((w) => conditionOf(w, own, wells));
  assert.deepEqual(conditions, ["measuring", "active", "pending"], "numbers are made while the next is brought");
  for (const under of [own, null, specimen("B01", []), specimen("H12", [])]) {
    assert.deepEqual(
      conditionsOf(wells, under),
      wells.map((w) => conditionOf(w, under, wells)),
      "all at once as one by one",
    );
  }
  assert.deepEqual(
    wells.map((w) => conditionOf(w, null, wells)),
    ["pending", "pending", "pending"],
  );
  assert.equal(conditionOf(well("B02", { outcome: "succeeded" }), own), "succeeded", "an outcome outweighs the phase");
  assert.equal(conditionOf(well("B02", { outcome: "succeeded", flags: ["drift"] }), null), "flagged");
  assert.equal(conditionOf(well("B02", { outcome: "skipped" }), null), "skipped");
  assert.equal(
    spoken(well("B02", { outcome: "skipped", reason: "two_specimens" }), "skipped"),
    "B02, larva, 3 dpf, skipped: two specimens",
  );
  const planned = {
    well: "B02",
    compound: "BPA",
    concentration: 10,
    concentration_unit: "uM" as const,
    strain: "ABxTL",
  };
  assert.equal(
    spoken(well("B02"), "pending", planned),
    "B02, larva, 3 dpf, BPA 10 µM, ABxTL, not measured yet",
    "how it was treated",
  );
});

test("a larva's place is said per number, with what of it does not match", () => {
  assert.deepEqual(places(well("A01")), []);
  assert.deepEqual(places(well("A01", { reference: placed })), [
    { text: "Volume: no reference of 3 dpf.", doubts: "" },
    {
      text: "Area 0.8 SD below the mean of 12 larvae of 3 dpf.",
      doubts:
        "Compare with care: voxel edge: 6.93 um, the reference's not stated; mode: simulated, the reference's hardware.",
    },
  ]);
  assert.deepEqual(
    places(well("A01", { reference: placed, flags: ["clipped_left"] })),
    [{ text: "Not compared: part of the larva was not measured.", doubts: "" }],
    "a bound has no place",
  );
  const none = { group: null, n: null, z: null, percentile: null, mismatches: [] };
  const eye_volume = { ...none, words: "eye volume: no reference of the eyes of 4 dpf" };
  assert.deepEqual(places(well("A01", { reference: { ...placed, eye_volume } }))[2], {
    text: "Eye volume: no reference of the eyes of 4 dpf.",
    doubts: "",
  });
});
