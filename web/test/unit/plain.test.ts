import assert from "node:assert/strict";
import { test } from "node:test";
import { VolumeHistory } from "../../src/history.ts";
import { Latest } from "../../src/latest.ts";
import { contents } from "../../src/newrun.ts";
import {
  canAbort,
  canGoOn,
  canHold,
  canStart,
  canStop,
  diagnosis,
  finish,
  handedOver,
  Furthest,
  headline,
  mayStillCome,
  nextStep,
  progress,
  progressLine,
  tally,
  toneOf,
} from "../../src/plain.ts";
import { levelDigits, linearTicks, roundBelow, viewTicks } from "../../src/ticks.ts";
import type { Fault, Hold } from "../../src/status.ts";
import { fault, run, specimen, status, well } from "../support/statuses.ts";

const half = status({
  state: "Execute",
  run: run([well("A01", { outcome: "succeeded" }), well("A02")]),
  specimen: specimen("A02", new Array<number>(11).fill(1)),
});

test("the progress bar of a run does not move back, and another run has its own", () => {
  const furthest = new Furthest();
  assert.deepEqual(
    (
      [
        ["a", 0.4],
        ["a", 0],
        ["a", 0.5],
        ["b", 0.1],
        [null, 0],
      ] as const
    ).map(([run, share]) => furthest.of(run, share)),
    [0.4, 0.4, 0.5, 0.1, 0],
  );
});

test("progress counts wells, and the specimen under way by its views", () => {
  assert.equal(progress(status()), 0);
  assert.equal(progress(half), 0.75);
  assert.equal(progress({ ...half, specimen: null }), 0.5);
  assert.equal(progress({ ...half, specimen: specimen("A01", [1, 1]) }), 0.5, "a well that has ended counts once");
  const done = run([well("A01", { outcome: "succeeded" })], { outcome: "succeeded" });
  assert.equal(progress({ ...half, run: done }), 1);
  const aborted = run([well("A01", { outcome: "succeeded" }), well("A02", { outcome: "aborted" })], {
    outcome: "aborted",
  });
  assert.equal(progress({ ...half, run: aborted }), 0.5, "what was left out is not done");
  // The next specimen is loaded while the numbers of the one before are made: the bar does not fall back.
  const three = run([well("A01"), well("A02"), well("A03")]);
  const turned = progress({ ...half, run: three, specimen: specimen("A01", new Array<number>(22).fill(1)) });
  const loading = progress({ ...half, run: three, specimen: specimen("A02", [], { phase: "load" }) });
  assert.deepEqual([turned, loading], [1 / 3, 1 / 3]);
  assert.equal(progress({ ...half, state: "Held" }), 0.5, "a held run has given its specimen up");
});

test("the line under the sentence says how far, or how it ended", () => {
  assert.equal(progressLine(half), "Run demo-1: 1 of 2 wells done · about 2 min left.");
  const plate = { ...half.plate, bring: "A02" };
  assert.equal(progressLine({ ...half, plate }), "Run demo-1: 1 of 2 wells done.", "nobody knows when a hand is done");
  assert.equal(finish({ ...half, plate }), "");
  const ended = run([well("A01", { outcome: "failed" }), well("A02", { outcome: "skipped" })], { outcome: "failed" });
  assert.equal(progressLine({ ...half, run: ended }), "Run demo-1 failed: 1 skipped, 1 failed.");
  assert.equal(tally(ended), "1 skipped, 1 failed");
  assert.equal(progressLine(status()), "Ready for a run.");
});

const hold: Hold = {
  code: "rotation_lost",
  cause: "The axis' controller does not answer any more.",
  times: 4,
  next_action: "Find out why it comes back. Then let the run go on.",
  next_command: "unhold",
  fault_seq: null,
  next_try: null,
};
const heldBy = (change: Partial<Hold>, faults: Fault[] = []) => ({
  ...half,
  state: "Held" as const,
  run: run([well("A01")], { hold: { ...hold, ...change } }),
  faults,
});

test("the headline is the next step, and why stands below it", () => {
  assert.deepEqual(nextStep(heldBy({})), { words: hold.next_action, button: "unhold", fault: null });
  assert.equal(headline(heldBy({})), hold.next_action);
  assert.equal(
    diagnosis(heldBy({})),
    "Held by a cause that is over: The axis' controller does not answer any more. It has held the run 4 times since a well was finished.",
  );
  const lost = fault({ seq: 3, code: "rotation_lost", operator_required: true, ends_by_itself: true });
  const stands = heldBy({ times: 1, next_action: "Check its cable.", next_command: null, fault_seq: 3 }, [lost]);
  assert.deepEqual(nextStep(stands), { words: "Check its cable.", button: null, fault: 3 });
  assert.equal(canGoOn(stands), false, "while the cause stands");
  assert.equal(canGoOn(heldBy({})), true);
  const pauses = heldBy({ code: "camera_no_frame", times: 1, next_try: "2026-03-05T12:34:00Z" }, []);
  assert.match(diagnosis(pauses), / The next try is at \d\d:\d\d\.$/);
  assert.equal(diagnosis(stands), "Held because: The axis' controller does not answer any more.");
  const asked = heldBy({ code: "operator", cause: "An operator asked for it.", times: 1 });
  assert.equal(diagnosis(asked), "Held because: An operator asked for it.");
  assert.equal(nextStep(heldBy({ next_action: null, next_command: null })), null, "it goes on by itself");
  // Without a run a fault asks for somebody; what ends by itself has no button.
  const idle = (one: Partial<Fault>) => nextStep(status({ faults: [fault({ operator_required: true, ...one })] }));
  assert.deepEqual(idle({}), { words: "Look at the camera's cable.", button: "acknowledge", fault: 7 });
  assert.equal(idle({ ends_by_itself: true })?.button, null);
  assert.equal(nextStep(half), null);
  assert.equal(headline(half), "Waiting for a run");
  assert.equal(diagnosis(half), "");
});

test("who exchanges specimens by hand reads what to do, one step after the other", () => {
  const plate = { ...half.plate, take_out: "A01", bring: "A02" };
  assert.match(headline({ ...half, plate }), /^By hand: take the specimen of A01 out/);
  assert.equal(nextStep({ ...half, plate })?.button, "is-out");
  assert.match(diagnosis({ ...half, plate }), /A plate-loader does this by itself\.$/);
  const late = { ...half, plate, specimen: specimen("A01", [], { in_capillary: false }) };
  assert.ok(mayStillCome(late) && !mayStillCome({ ...half, plate }));
  assert.doesNotMatch(diagnosis(late), /by itself|key N/, "nothing but a person ends it");
  assert.match(headline(late), /A01 may still come\. Take it out .* Confirm too if it does not come\.$/);
  const next = nextStep({ ...half, plate: { ...plate, take_out: null } });
  assert.match(next?.words ?? "", /^By hand: put the specimen of A02 into/);
  assert.equal(next?.button, "is-in");
});

test("the tone is that of the worst that is so", () => {
  assert.equal(toneOf(status()), "calm");
  assert.equal(toneOf(half), "busy");
  assert.equal(toneOf({ ...half, faults: [fault()] }), "attention");
  assert.equal(toneOf({ ...half, faults: [fault(), fault({ operator_required: true })] }), "alarm");
  assert.equal(toneOf({ ...half, state: "Held" }), "attention");
  const camera = { ...half.hardware.camera, connected: false };
  assert.equal(toneOf({ ...half, hardware: { ...half.hardware, camera } }), "attention", "it is looked for");
  assert.equal(toneOf({ ...half, state: "Aborted" }), "alarm");
  assert.equal(toneOf(status({ state: "Complete", run: run([], { outcome: "succeeded" }) })), "good");
  assert.equal(toneOf(status({ state: "Complete", run: run([], { outcome: "partial" }) })), "attention");
  assert.equal(toneOf(status({ state: "Complete", run: run([], { outcome: "failed" }) })), "alarm");
});

test("only a run under way can be aborted, and once", () => {
  assert.equal(canAbort(status()), false);
  assert.equal(canAbort(half), true);
  assert.equal(canAbort({ ...half, pending: { hold: false, stop: false, abort: true } }), false);
  assert.equal(canAbort({ ...half, run: run([], { outcome: "failed" }) }), false);
});

test("each command is offered where it applies", () => {
  const held = { ...half, state: "Held" as const, run: run([], { held_by_operator: true }) };
  const heldByFault = { ...held, run: run([], { goes_on_by_itself: true }) };
  const stopping = { ...half, pending: { hold: false, stop: true, abort: false } };
  assert.deepEqual([half, held, heldByFault, stopping, status()].map(canHold), [true, false, true, false, false]);
  assert.deepEqual([half, held, stopping, status()].map(canGoOn), [false, true, false, false]);
  assert.deepEqual([half, held, stopping, status()].map(canStop), [true, true, false, false]);
  assert.deepEqual([half, held, stopping, status()].map(canStart), [false, false, false, true]);
  assert.equal(canStart(status({ state: "Stopping" })), false);
  assert.equal(canStart(status({ state: "Stopped" })), true);
});

test("a handover that is open is told by the status' words", () => {
  const notReady = (why: string | null) => handedOver(status({ ready: why === null, not_ready_reason: why }));
  assert.equal(notReady("plate P-1.b_2 is being handed over"), "P-1.b_2");
  assert.equal(notReady("a fault stands: The disk is full."), null);
  assert.equal(notReady(null), null);
});

test("a plate map in one line", () => {
  const larva = (dpf?: number) => ({ well: "A01", ...(dpf === undefined ? {} : { dpf }) });
  assert.equal(
    contents([larva(5), larva(3), larva(3), larva(), { well: "A05", specimen: "bead" }]),
    "5 wells: 2 larvae of 3 dpf, 1 larva of 5 dpf, 1 larva of unknown age, 1 bead.",
  );
});

test("volumes are kept per well until another run starts, and begin again with a turn", () => {
  const history = new VolumeHistory();
  const hulls = (name: string) => history.of(name).hulls_um3;
  const open = { ...half, run: run([well("A01"), well("A02")]) };
  const estimates = [{ views: 7, volume_um3: 4, volume_sd_um3: 1 }];
  history.take({ ...open, specimen: specimen("A01", [5, 4], { estimates }) });
  history.take({ ...open, specimen: specimen("A02", []) });
  history.take({ ...open, specimen: specimen("A02", [7]) });
  history.take({ ...open, specimen: null });
  assert.deepEqual([hulls("A01"), hulls("A02")], [[5, 4], [7]]);
  assert.deepEqual(history.of("A01").estimates, estimates);
  history.take({ ...open, specimen: specimen("A01", [], { phase: "position" }) });
  assert.deepEqual(history.of("A01"), { hulls_um3: [], estimates: [] }, "it is tried again from its first view");
  history.take({ ...half, run: run([well("A01")], { id: "next" }), specimen: null });
  assert.deepEqual(hulls("A02"), []);
  const again = run([well("A01")], { id: "next", started: "2026-03-06T09:30:00Z" });
  const kept = { hulls_um3: [9, 8], estimates };
  history.recall(run([], { id: "next" }), "A01", kept);
  assert.deepEqual(history.of("A01"), kept);
  history.take({ ...half, run: again, specimen: null });
  assert.deepEqual(hulls("A01"), [], "another run of the same name");
  assert.equal(history.recall(run([], { id: "next" }), "A01", kept), false);
});

test("ticks are round and enclose the values", () => {
  assert.deepEqual(linearTicks(224.1, 229.8), [224, 226, 228, 230]);
  assert.deepEqual(linearTicks(0, 990), [0, 200, 400, 600, 800, 1000]);
  for (const [lowest, highest] of [
    [65.4, 65.4],
    [-0.3, 2.1],
    [0.0131, 0.0137],
    [1e5, 3e5],
  ] as const) {
    const ticks = linearTicks(lowest, highest);
    const labels = new Set(ticks.map((tick) => tick.toFixed(levelDigits(ticks))));
    assert.equal(labels.size, ticks.length, `${lowest} to ${highest}: equal labels`);
    assert.ok(ticks.length >= 2 && ticks.length <= 9, `${ticks}`);
    assert.ok(ticks[0]! <= lowest && ticks.at(-1)! >= highest && ticks[0]! < ticks.at(-1)!, `${ticks}`);
  }
  assert.equal(roundBelow(999), 500);
  assert.equal(roundBelow(0.3), 0.2);
  assert.deepEqual(viewTicks(22), [1, 5, 10, 15, 22]);
  assert.deepEqual(viewTicks(2), [1, 2]);
});

test("the newest wins: never two loads at once, one more when news came meanwhile", async () => {
  const steps: (() => void)[] = [];
  let started = 0;
  const latest = new Latest(() => {
    started += 1;
    return new Promise<void>((resolve) => steps.push(resolve));
  });
  const first = latest.ask();
  for (let i = 0; i < 5; i += 1) void latest.ask();
  assert.equal(started, 1);
  steps[0]!();
  await new Promise((resolve) => setImmediate(resolve));
  assert.equal(started, 2, "five questions are one more load");
  steps[1]!();
  await first;
  assert.equal(started, 2);
});
