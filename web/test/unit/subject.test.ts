import assert from "node:assert/strict";
import { test } from "node:test";
import { FLAGS } from "../../src/flags.ts";
import { withSpread } from "../../src/format.ts";
import { flagWords, reasonWords } from "../../src/reasons.ts";
import { chosenWell, subjectOf } from "../../src/subject.ts";
import { run, specimen, status, well } from "../support/statuses.ts";

const results = [
  well("A01", { outcome: "succeeded", volume_um3: 1 }),
  well("A02"),
  well("A03", { outcome: "aborted", views: 0 }),
  well("A04"),
];
const half = status({ state: "Execute", run: run(results), specimen: specimen("A02", [1]) });

test("pictures are the run's newest, or those of the well that was chosen", () => {
  const live = { kind: "live", run: "demo-1", well: null };
  assert.deepEqual(subjectOf(half, null), live);
  assert.deepEqual(subjectOf(half, "A01"), {
    kind: "stored",
    run: "demo-1",
    started: half.run!.started,
    well: "A01",
  });
  assert.deepEqual(subjectOf(half, "A02"), { ...live, well: "A02" });
  for (const name of ["A03", "A04"]) {
    const none = subjectOf(half, name);
    assert.ok(none.kind === "none" && none.words.includes(name), name);
  }
  const over = { ...half, run: run(results, { outcome: "partial" as const }), specimen: null };
  assert.deepEqual(
    subjectOf(over, null),
    subjectOf(half, "A01"),
    "beside the numbers that are shown, those of no other well",
  );
  const nothing = { ...over, run: run([well("A01", { outcome: "skipped" })], { outcome: "succeeded" as const }) };
  assert.deepEqual(subjectOf(nothing, null), subjectOf(half, "A01"), "the frame that judged it");
  assert.equal(subjectOf(status(), null).kind, "none");
});

test("a well that was cut short shows its views, and one without a view says so", () => {
  const wells = [
    well("A01", { outcome: "succeeded", volume_um3: 1 }),
    well("A02", { outcome: "aborted", views: 13, reason: "the run was aborted" }),
    well("A03", { outcome: "aborted", views: 0, reason: "the run was aborted" }),
    well("A04", { outcome: "interrupted", views: 2 }),
    well("A05", { outcome: "aborted" }),
  ];
  const over = { ...half, state: "Aborted" as const, run: run(wells, { outcome: "aborted" }), specimen: null };
  const kinds = wells.map((w) => subjectOf(over, w.well).kind);
  assert.deepEqual(kinds, ["stored", "stored", "none", "stored", "stored"], "early versions counted no views");
  assert.deepEqual(subjectOf(over, "A03"), {
    kind: "none",
    words: "Well A03: not measured: the run was ended before its first view.",
  });
  // With hand exchange the specimen stays inside: the pictures are those of the well in the ring.
  const left = { ...over, specimen: specimen("A02", [1]) };
  assert.equal(chosenWell(left, null), "A02");
  assert.deepEqual(subjectOf(left, null), subjectOf(over, "A02"));
  // Without a number the ring is on the well that has views.
  const first = { ...over, run: run(wells.slice(1, 3), { outcome: "aborted" }) };
  assert.equal(chosenWell(first, null), "A02");
});

test("the well to show: the operator's, or the one under way, or the last that was measured", () => {
  assert.equal(chosenWell(half, "A04"), "A04");
  assert.equal(chosenWell(half, null), "A02");
  assert.equal(chosenWell(half, "H12"), "A02", "a well of another plate");
  assert.equal(chosenWell({ ...half, specimen: null }, null), "A01");
  assert.equal(chosenWell(status(), null), null);
  // Held, ring and pictures are of one well: the one that was begun, else the last that has ended.
  const held = { ...half, state: "Held" as const };
  assert.equal(chosenWell(held, null), "A02");
  assert.deepEqual(subjectOf(held, null), { kind: "live", run: "demo-1", well: "A02" });
  const next = { ...held, specimen: specimen("A02", [], { in_capillary: false, phase: "load" as const }) };
  assert.equal(chosenWell(next, null), "A01");
  assert.deepEqual(subjectOf(next, null), subjectOf(half, "A01"));
});

test("a spread has two digits, and its value ends at the same place", () => {
  assert.equal(withSpread(226.713404, 1.392), "226.7 ± 1.4");
  assert.equal(withSpread(3.240145, 0.006528), "3.2401 ± 0.0065");
  assert.equal(withSpread(1234.5, 99.6), "1,235 ± 100");
  assert.equal(withSpread(1, 0), "1.0000 ± 0.0000");
});

test("a reason that is a code is said in words, free text stays as it is", () => {
  assert.equal(reasonWords("two"), "two larvae");
  assert.equal(reasonWords("not_seen_yet"), "not seen yet");
  const command = "run `carved measure /data/runs/run_1/A01`";
  assert.equal(reasonWords(command), command);
});

test("every flag is said in plain words, with what to do", () => {
  assert.equal(
    flagWords("few_views"),
    "too few views count, or no view sees an edge over a wide angle: find out why views were left out, or take more views",
  );
  for (const flag of Object.keys(FLAGS)) assert.match(flagWords(flag), /^[a-z].*: [a-z][^.]*$/, flag);
  assert.equal(flagWords("flag_of_another_version"), "flag of another version");
});
