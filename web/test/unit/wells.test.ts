import assert from "node:assert/strict";
import { test } from "node:test";
import { conditionOf, formatFor, place, places, PLATE_384, PLATE_96, spoken, wellName } from "../../src/wells.ts";
import { placed, specimen, well } from "../support/statuses.ts";

test("names and places are each other's inverse on the whole plate", () => {
  for (let row = 0; row < 16; row += 1) {
    for (let column = 0; column < 24; column += 1) {
      assert.deepEqual(place(wellName(row, column)), { row, column });
    }
  }
  assert.deepEqual(place("A01"), { row: 0, column: 0 });
  assert.deepEqual(place("H12"), { row: 7, column: 11 });
  for (const wrong of ["A1", "A00", "A25", "Q01", "a01", "A001", ""]) assert.equal(place(wrong), null, wrong);
});

test("the plate is the smaller one that holds every well", () => {
  assert.equal(formatFor([]), PLATE_96);
  assert.equal(formatFor(["A01", "H12"]), PLATE_96);
  assert.equal(formatFor(["A01", "I01"]), PLATE_384);
  assert.equal(formatFor(["A13"]), PLATE_384);
});

test("a well's condition follows its outcome, its flags and the specimen under way", () => {
  const own = specimen("B02", [1]);
  assert.equal(conditionOf(well("B02"), null), "pending");
  assert.equal(conditionOf(well("B02"), specimen("B03", [1])), "pending");
  assert.equal(conditionOf(well("B02"), own), "active");
  const wells = [well("B01"), well("B02"), well("B03")];
  const conditions = wells.map((w) => conditionOf(w, own, wells));
  assert.deepEqual(conditions, ["measuring", "active", "pending"], "numbers are made while the next is brought");
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
});

test("a larva's place is said per number, with what of it does not match", () => {
  assert.deepEqual(places(well("A01")), []);
  assert.deepEqual(places(well("A01", { reference: placed })), [
    { text: "Volume: no reference of 3 dpf.", doubts: "" },
    {
      text: "Area 0.8 SD below the mean of 12 larvae of 3 dpf.",
      doubts:
        "Not the same or not known: voxel edge: 6.93 um, the reference's not stated; mode: simulated, the reference's hardware.",
    },
  ]);
});
