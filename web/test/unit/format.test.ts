import assert from "node:assert/strict";
import { test } from "node:test";
import * as format from "../../src/format.ts";

test("thousands are separated and zero has no sign", () => {
  assert.equal(format.grouped(0), "0");
  assert.equal(format.grouped(999), "999");
  assert.equal(format.grouped(1000), "1,000");
  assert.equal(format.grouped(243123456.4), "243,123,456");
  assert.equal(format.grouped(1234.5678, 2), "1,234.57");
  assert.equal(format.grouped(0.123456, 6), "0.123456", "decimals stay together");
  assert.equal(format.grouped(-1234.5, 1), "−1,234.5");
  assert.equal(format.grouped(-0.001, 2), "0.00");
});

test("four digits say what a volume is, from a bead to a plate of them", () => {
  assert.equal(format.nanolitres(65_449_847), "65.45\u202fnL");
  assert.equal(format.nanolitres(243_123_456), "243.1\u202fnL");
  assert.equal(format.nanolitres(1_204_400_000), "1,204\u202fnL");
  assert.equal(format.nanolitres(12_044_400_000), "12,044\u202fnL");
  assert.equal(format.nanolitres(65_450), "0.06545\u202fnL");
  assert.equal(format.nanolitres(0), "0\u202fnL");
  assert.equal(format.cubicMicrometres(243_123_456.4), "243,123,456\u202fµm³");
  assert.equal(format.squareMillimetres(785_398), "0.7854\u202fmm²");
});

test("durations use the unit that says something", () => {
  assert.equal(format.duration(0.2), "0 s");
  assert.equal(format.duration(59.4), "59 s");
  assert.equal(format.duration(59.6), "1 min");
  assert.equal(format.duration(200), "3 min 20 s");
  assert.equal(format.duration(7500), "2 h 5 min");
  assert.equal(format.duration(-3), "0 s");
  assert.equal(format.aboutDuration(20), "less than a minute");
  assert.equal(format.aboutDuration(130), "about 2 min");
  assert.equal(format.aboutDuration(20_000), "about 5 h 35 min");
});

test("bytes, words and times", () => {
  assert.equal(format.bytes(999), "999 B");
  assert.equal(format.bytes(412_300_000_000), "412 GB");
  assert.equal(format.bytes(4_130_000_000), "4.13 GB");
  assert.equal(format.words("out_of_focus"), "out of focus");
  assert.equal(format.counted(1, "view"), "1 view");
  assert.equal(format.counted(1204, "view"), "1,204 views");
  assert.equal(format.capitalised(""), "");
  assert.match(format.clockTime("2026-03-05T09:31:12Z"), /^\d\d:\d\d:12$/);
  assert.equal(format.clockTime("yesterday"), "yesterday");
});

test("a concentration has the digits that were entered, and a micro sign", () => {
  assert.deepEqual([1.5, 10, 0.5, 0, 1500, 0.1 * 3].map(format.asEntered), ["1.5", "10", "0.5", "0", "1500", "0.3"]);
  assert.deepEqual(["uM", "ug/mL", "nM", "%"].map(format.unitWords), ["µM", "µg/mL", "nM", "%"]);
});
