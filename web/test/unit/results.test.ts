import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { callFor } from "../../src/calls.ts";
import { sorted } from "../../src/results.ts";
import { entryOf } from "../../src/runlog.ts";
import { asStatus, copyWords, fits } from "../../src/runs.ts";
import { fault, placed, run, status, well } from "../support/statuses.ts";

test("wells without a number come last in both directions", () => {
  const wells = [
    well("A02", { volume_um3: 2e6 }),
    well("A01"),
    well("A10", { volume_um3: 3e6 }),
    well("A03", { volume_um3: 1e6 }),
  ];
  const names = (column: number, descending: boolean) => sorted(wells, column, descending).map((w) => w.well);
  assert.deepEqual(names(4, false), ["A03", "A02", "A10", "A01"]);
  assert.deepEqual(names(4, true), ["A10", "A02", "A03", "A01"]);
  assert.deepEqual(names(0, false), ["A01", "A02", "A03", "A10"]);
});

test("a bound has no distance from references, and comes last", () => {
  const place = (z: number) => ({ words: "", group: "g", n: 12, z, percentile: null, mismatches: [] });
  const at = (z: number) => ({ ...placed, volume: place(z), area: place(z) });
  const wells = [
    well("A01", { reference: at(-12), flags: ["clipped_left"] }),
    well("A02", { reference: at(1) }),
    well("A03", { reference: at(-1) }),
  ];
  const names = (column: number) => sorted(wells, column, false).map((w) => w.well);
  assert.deepEqual(names(8), ["A03", "A02", "A01"]);
  assert.deepEqual(names(9), ["A03", "A02", "A01"]);
});

test("wells are sorted by their treatment, those without one last", () => {
  const planned = new Map([
    ["A01", { well: "A01", compound: "DMSO" }],
    ["A03", { well: "A03", compound: "BPA", concentration: 10, concentration_unit: "uM" as const }],
  ]);
  const wells = ["A01", "A02", "A03"].map((name) => well(name));
  assert.deepEqual(
    sorted(wells, 2, false, planned).map((w) => w.well),
    ["A03", "A01", "A02"],
  );
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

const said = (kind: string, data: unknown, well: string | null = "A01") => {
  const { weight, words } = entryOf({ id: 1, time: "2026-03-05T09:30:00Z", kind, run: "r", well, data });
  return `${weight}: ${words}`.replaceAll("\u202f", " ");
};

/** Each kind of event of a run: what comes with it, and what the page says. */
const EVENTS: [kind: string, data: unknown, words: string][] = [
  [
    "run.accepted",
    { plate_barcode: "P-1", method: "standard" },
    "news: The run was accepted for plate P-1, method standard.",
  ],
  ["run.started", null, "news: The instrument is ready; the wells follow."],
  ["run.hold_requested", null, "news: A command without a known source asked to hold the run."],
  ["run.hold_requested", { by: "Kim", from: "10.0.0.7" }, "news: Kim (10.0.0.7) asked to hold the run."],
  [
    "run.hold_requested",
    { from: "10.0.0.7, with the lease of loader 1" },
    "news: A client at 10.0.0.7, with the lease of loader 1 (no name given) asked to hold the run.",
  ],
  [
    "run.resumed",
    { by: "operator", from: "the instrument's computer" },
    "news: A client at the instrument's computer (no name given) lets the run go on.",
  ],
  ["run.resumed", { by: "operator", name: "Kim" }, "news: Kim lets the run go on."],
  ["fault.acknowledged", { code: "rotation_lost", by: "Kim" }, "news: Kim acknowledged the fault rotation lost."],
  ["well.skipped", { by: "Kim", reason: "no larva" }, "news: Kim skips A01: no larva."],
  ["well.redo_requested", { by: "Kim", reason: "a bubble" }, "news: Kim has A01 measured again: a bubble."],
  [
    "well.noted",
    { by: "Kim", time: "", excluded: true, comment: "two larvae", tags: [] },
    "news: A01: Left out of statistics by Kim: two larvae.",
  ],
  ["run.stop_requested", null, "news: A command without a known source asked to stop the run after the well."],
  ["run.abort_requested", null, "trouble: A command without a known source asked to abort the run."],
  ["run.held", { by: "fault", cause: "The camera is silent." }, "trouble: The run is held: The camera is silent."],
  ["run.held", { by: "fault", code: "rotation_lost" }, "trouble: The run is held: rotation lost."],
  ["run.held", { by: "operator" }, "news: An operator holds the run."],
  ["run.resumed", { by: "instrument" }, "news: The run continues by itself."],
  ["run.resumed", { by: "operator" }, "news: A command without a known source lets the run go on."],
  ["run.interrupted", { found: "at start" }, "trouble: The program was started again and found the run open."],
  [
    "run.unreadable",
    { run: "r", why: "run.json ends early" },
    "trouble: The record of the run could not be read: run.json ends early.",
  ],
  ["run.ended", { outcome: "partial" }, "news: The run finished in part."],
  ["run.ended", { outcome: "aborted" }, "news: The run was aborted."],
  ["well.awaited", null, "step: The loader is asked for the specimen of A01."],
  ["well.loaded", { in_place_of: null }, "step: The specimen of A01 is in the capillary."],
  ["well.taken_out", null, "step: The specimen of A01 was taken out while the sampler was at work."],
  ["well.unloaded", null, "step: The specimen of A01 was taken out."],
  ["specimen.phase", { phase: "revolve" }, "step: A01: taking views."],
  ["specimen.detected", { kind: "larva" }, "step: A01: the first frame shows a larva."],
  ["specimen.detected", { kind: "bead" }, "step: A01: the first frame shows a bead."],
  ["specimen.detected", { kind: "empty" }, "step: A01: the first frame shows nothing."],
  ["specimen.detected", { kind: "two" }, "step: A01: the first frame shows two larvae or more."],
  ["specimen.detected", { kind: "bubble" }, "step: A01: the first frame shows an air bubble."],
  ["specimen.detected", { kind: "debris" }, "step: A01: the first frame shows debris."],
  ["specimen.detected", null, "step: A01: the first frame shows what cannot be judged."],
  [
    "specimen.tried_again",
    { attempt: 1, why: "no outline" },
    "trouble: A01 is measured again: attempt 1 failed, no outline.",
  ],
  [
    "specimen.unasked",
    { there: true },
    "trouble: The sampler's sensor shows a specimen that no run asked for. Take it out.",
  ],
  ["specimen.unasked", { there: false }, "news: The specimen that no run asked for is gone."],
  [
    "specimen.interrupted",
    { reason: "rotation_lost", policy: "redo", kept: false },
    "trouble: A01 was interrupted (rotation lost): it is measured again from the start.",
  ],
  [
    "specimen.interrupted",
    { reason: "", policy: "redo", kept: true },
    "trouble: A01 was interrupted: it stays in the capillary, and the run continues with it.",
  ],
  ["specimen.interrupted", { reason: "", policy: "skip" }, "trouble: A01 was interrupted: it is given up."],
  ["specimen.recovering", { attempt: 1 }, "news: A01: its numbers are computed from the stored frames."],
  ["specimen.recovered", null, "news: A01: its numbers were computed from the stored frames."],
  ["specimen.done", { outcome: "succeeded", volume_um3: 2.4e8 }, "news: A01: measured, 240.0 nL."],
  ["specimen.done", { outcome: "failed", reason: "No outline." }, "trouble: A01: failed: No outline."],
  ["specimen.done", { outcome: "aborted" }, "news: A01: not measured."],
  ["specimen.done", { outcome: "interrupted" }, "trouble: A01: interrupted and given up."],
  ["specimen.done", { outcome: "skipped", reason: "empty" }, "news: A01: skipped: the capillary is empty."],
  [
    "specimen.done",
    { outcome: "succeeded", volume_um3: 243.1e6, volume_sd_um3: 1.4e6, flags: ["dead_looking"], seconds: 61 },
    "trouble: A01: measured, 243.1 ± 1.4 nL (the larva is opaque in most views, and much darker than the larvae that the rig measured before it: look at it, and leave it out of the results if it is dead), after 1 min 1 s.",
  ],
  [
    "fault.raised",
    { meaning: "The camera does not answer", message: "no frame for 1.5 s" },
    "trouble: The camera does not answer. No frame for 1.5 s.",
  ],
  ["fault.raised", { message: "no frame for 1.5 s" }, "trouble: No frame for 1.5 s."],
  ["fault.raised", { meaning: "The disk is full.", message: "the disk is full" }, "trouble: The disk is full."],
  [
    "fault.acknowledged",
    { seq: 7, code: "camera_silent" },
    "news: A command without a known source acknowledged the fault camera silent.",
  ],
  ["fault.cleared", { seq: [7], why: "it answers" }, "news: A fault is over: it answers."],
  ["fault.cleared", { seq: [7], why: "" }, "news: A fault is over."],
  ["daemon.stopping", null, "trouble: The program was told to end while the run was open."],
  ["store.regained", null, "news: The disk takes writes again."],
];

test("events are said in words, with what is trouble and what is only a step", () => {
  for (const [kind, data, words] of EVENTS) assert.equal(said(kind, data), words, kind);
  assert.equal(said("pump.primed", null), "step: Pump: primed, A01.", "a kind of a newer version");
  assert.equal(said("pump.primed", null, null), "step: Pump: primed.");
});

test("every kind of event of a run that the documents list has words of its own", async () => {
  const documents = await readFile(new URL("../../../../docs/files.md", import.meta.url), "utf8");
  const list = documents.split("* `events.jsonl`:")[1]!.split("\n* ")[0]!;
  const kinds = [...list.matchAll(/`((?:run|well|specimen|fault)\.(?!json)[a-z_]+)`/g)].map((match) => match[1]!);
  assert.ok(kinds.length > 15, kinds.join());
  const known = new Set(EVENTS.map(([kind]) => kind));
  assert.deepEqual(
    kinds.filter((kind) => !known.has(kind)),
    [],
  );
});
