import assert from "node:assert/strict";
import { test } from "node:test";
import { doneWords } from "../../src/wells.ts";
import { choices, typedTags } from "../../src/remark.ts";
import { noteWords } from "../../src/wellcard.ts";
import { run, well } from "../support/statuses.ts";

test("tags are read as people type them", () => {
  assert.deepEqual(typedTags(" twin, oedema;twin ,, "), ["twin", "oedema"]);
  assert.deepEqual(typedTags(" "), []);
});

test("a held run skips what it has not measured and repeats what it has, and a run that has ended repeats alone", () => {
  const [open, done] = [well("A01"), well("A02", { outcome: "succeeded" })];
  const [live, ended] = [run([open, done]), run([open, done], { outcome: "aborted" })];
  assert.deepEqual(choices(live, open, true), { skip: true, redo: false });
  assert.deepEqual(choices(live, done, true), { skip: false, redo: true });
  assert.deepEqual(choices(live, open, false), { skip: false, redo: false });
  assert.deepEqual(choices(live, done, false), { skip: false, redo: false });
  assert.deepEqual(choices(ended, done, false), { skip: false, redo: true });
  assert.deepEqual(choices(null, null, false), { skip: false, redo: false });
});

test("a remark names its person and what it does", () => {
  const note = { by: "Kim", time: "", excluded: true, comment: "two larvae.", tags: ["twin", "big"] };
  assert.equal(noteWords(note), "Left out of statistics by Kim: two larvae. Tags: twin, big.");
  assert.equal(noteWords({ ...note, excluded: false, tags: [] }), "Kim: two larvae.");
  assert.equal(noteWords({ ...note, excluded: false, comment: "", tags: ["a"] }), "Kim. Tags: a.");
});

test("a finished well is told in one line, and a bound has no interval", () => {
  const done = {
    outcome: "succeeded",
    volume_um3: 245e6,
    volume_sd_um3: 2e6,
    area_um2: 3.42e6,
    area_sd_um2: 2e4,
  } as const;
  assert.match(doneWords(well("A01", done)), /^245.* ± 2.*nL, 3\.42.* ± 0\.02.*mm²$/);
  const bound = doneWords(well("A01", { ...done, flags: ["clipped_left"] }));
  assert.match(bound, /^at least 245[^,]*, at least 3\.42/);
  assert.doesNotMatch(bound, /±/);
  assert.equal(doneWords(well("A01", { outcome: "skipped", reason: "empty" })).length > 0, true);
});

test("a finished well with many flags has the meaning of one, and not what to do", () => {
  const flagged = (...flags: string[]) => doneWords(well("A01", { outcome: "succeeded", volume_um3: 245e6, flags }));
  const moved = "the specimen moved during the turn";
  assert.equal(flagged("moved").endsWith(`, ${moved}`), true);
  assert.equal(flagged("moved", "residual").endsWith(`, ${moved}, and 1 more flag`), true);
  assert.equal(flagged("moved", "residual", "overlap").endsWith(`, ${moved}, and 2 more flags`), true);
  assert.equal(flagged("of_another_version").endsWith(", of another version"), true);
});
