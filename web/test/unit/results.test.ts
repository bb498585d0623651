import assert from "node:assert/strict";
import { test } from "node:test";
import { callFor } from "../../src/calls.ts";
import { sorted } from "../../src/results.ts";
import { entryOf } from "../../src/runlog.ts";
import { asStatus, copyWords, fits } from "../../src/runs.ts";
import { fault, run, status, well } from "../support/statuses.ts";

test("wells without a number come last in both directions", () => {
  const wells = [
    well("A02", { volume_um3: 2e6 }),
    well("A01"),
    well("A10", { volume_um3: 3e6 }),
    well("A03", { volume_um3: 1e6 }),
  ];
  const names = (column: number, descending: boolean) => sorted(wells, column, descending).map((w) => w.well);
  assert.deepEqual(names(3, false), ["A03", "A02", "A10", "A01"]);
  assert.deepEqual(names(3, true), ["A10", "A02", "A03", "A01"]);
  assert.deepEqual(names(0, false), ["A01", "A02", "A03", "A10"]);
});

test("a person is called once for each need, and at the end of a run", () => {
  const going = status({ state: "Execute", run: run([well("A01")]) });
  const held = status({
    state: "Held",
    run: run([well("A01")]),
    faults: [fault({ operator_required: true })],
  });
  assert.equal(callFor(null, held), null, "a page that is opened calls nobody");
  assert.deepEqual(callFor(going, held), { title: "carved: Held", words: "Look at the camera's cable." });
  assert.equal(callFor(held, held), null);
  const other = { ...held, faults: [fault({ operator_required: true, what_to_do: "Make room on the data disk." })] };
  assert.equal(callFor(held, other)?.words, "Make room on the data disk.");
  assert.equal(callFor(held, going), null);
  const ended = status({
    state: "Complete",
    run: run([well("A01", { outcome: "succeeded" })], { outcome: "succeeded" }),
  });
  assert.equal(callFor(going, ended)?.title, "carved: the run has ended");
  assert.equal(callFor(ended, ended), null);
});

test("runs are found by words in any order", () => {
  const row = {
    ...{ id: "P-7-x", plate_barcode: "P-7", method: "standard", operator: "Kim", mode: "imported", external_id: null },
    ...{ outcome: "succeeded", software_version: "0.1.0", started: "2026-03-05T09:30:00Z", ended: null },
    wells: run([]).wells,
  };
  for (const search of ["", "kim p-7", "IMPORTED", "2026-03-05", "finished"]) assert.ok(fits(row, search), search);
  for (const search of ["lee", "p-8", "kim aborted"]) assert.ok(!fits(row, search), search);
  assert.ok(fits({ ...row, outcome: null }, "under way"));
});

test("a stored run has no commands, no faults and no specimen of the instrument", () => {
  const live = status({ state: "Held", faults: [fault()], run: run([well("A01")]) });
  const {
    eta_s: _,
    goes_on_by_itself: __,
    held_by_operator: ___,
    hold: ____,
    ...stored
  } = run([well("B02")], {
    id: "old",
    outcome: "succeeded",
  });
  const detail = {
    ...stored,
    ...{ plate_barcode: "P-9", mode: "hardware", method_settings: {}, software_version: "0.1.0", specimens: [] },
    copies: [],
    plan: { plate_barcode: "P-9", method: "standard", operator: "Kim", plate_map: [{ well: "B02" }] },
  };
  const shown = asStatus(detail, live);
  assert.deepEqual([shown.run?.id, shown.state, shown.faults.length, shown.specimen], ["old", "Complete", 0, null]);
  assert.deepEqual([shown.plate.barcode, shown.plate.bring, shown.run?.hold], ["P-9", null, null]);
});

test("the copies of a run are said with their place, size and day", () => {
  const copy = { archived: "2026-03-06T10:00:00Z", destination: "/nas/P-7", bytes: 1.25e9, files: 812 };
  assert.match(copyWords({ copies: [] }), /^No copy of this run is recorded/);
  assert.match(
    copyWords({ copies: [copy, copy] }),
    /^Copied to \/nas\/P-7 on 2026-03-06 .*: 812 files, 1\.25 GB, each read again after copying\. 1 earlier copy as well\.$/,
  );
  assert.match(copyWords({ copies: [copy, copy, copy] }), /2 earlier copies as well\.$/);
});

test("events are said in words, with what is trouble and what is only a step", () => {
  const said = (kind: string, data: unknown, well: string | null = "A01") => {
    const { weight, words } = entryOf({ id: 1, time: "2026-03-05T09:30:00Z", kind, run: "r", well, data });
    return `${weight}: ${words}`.replaceAll("\u202f", " ");
  };
  const done = {
    outcome: "succeeded",
    volume_um3: 243.1e6,
    volume_sd_um3: 1.4e6,
    flags: [],
    reason: null,
    seconds: 61,
  };
  assert.equal(said("specimen.done", done), "news: A01: measured, 243.1 ± 1.4 nL, after 1 min 1 s.");
  assert.equal(
    said("specimen.done", { ...done, flags: ["dead_looking"] }),
    "trouble: A01: measured, 243.1 ± 1.4 nL (it looks dead), after 1 min 1 s.",
  );
  assert.equal(
    said("specimen.done", { outcome: "skipped", reason: "empty", flags: [], volume_um3: null }),
    "news: A01: skipped: the capillary is empty.",
  );
  assert.equal(
    said("run.held", { by: "fault", cause: "The camera is silent." }, null),
    "trouble: The run is held: The camera is silent.",
  );
  assert.equal(said("run.held", { by: "operator" }, null), "news: An operator holds the run.");
  assert.equal(said("specimen.phase", { phase: "revolve" }), "step: A01: taking views.");
  assert.equal(
    said("specimen.interrupted", { reason: "rotation_lost", policy: "redo", kept: false }),
    "trouble: A01 was interrupted (rotation lost): it is measured again from the start.",
  );
  assert.equal(said("run.ended", { outcome: "partial" }, null), "news: The run finished in part.");
  assert.equal(said("pump.primed", null), "step: Pump: primed, A01.", "a kind of a newer version");
});
