import assert from "node:assert/strict";
import { test } from "node:test";
import { difference, progressWords, typedWells } from "../../src/again.ts";

test("wells are read as people type them", () => {
  assert.deepEqual(typedWells(" a1, B03;af48\nh12 "), ["A01", "B03", "AF48", "H12"]);
  assert.deepEqual(typedWells(" "), []);
  assert.deepEqual(typedWells("a9-a11, C03:C03"), ["A09", "A10", "A11", "C03"]);
  assert.deepEqual(typedWells("A1-B3 A3-A1 well"), ["A1-B3", "A3-A1", "WELL"], "the daemon says what is wrong");
});

test("how far measuring again has come is said in words, with the wells that failed", () => {
  const progress = { name: "few", wells: 5, done: 2, failed: [], waits: false };
  assert.equal(progressWords(progress), "2 of 5 wells measured by few …");
  assert.equal(
    progressWords({ ...progress, waits: true }),
    "2 of 5 wells measured by few, and waits until the run under way is over.",
  );
  const failed = [{ well: "B02", reason: "too few views" }];
  assert.equal(progressWords({ ...progress, done: 5, failed }), "4 of 5 wells measured by few. B02: too few views.");
  assert.equal(progressWords({ ...progress, wells: 1, done: 1 }), "1 of 1 well measured by few.");
});

test("a change is told in per cent of the first number", () => {
  assert.equal(difference(200, 203), "+1.5 %");
  assert.equal(difference(200, 199), "\u22120.5 %");
  assert.equal(difference(200, 200.01), "0.0 %");
  assert.equal(difference(null, 1), "–");
  assert.equal(difference(1, null), "–");
});
