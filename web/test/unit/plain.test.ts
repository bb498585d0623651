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
  handedOver,
  holdLine,
  progress,
  progressLine,
  tally,
  toneOf,
} from "../../src/plain.ts";
import { logTicks, roundBelow, viewTicks } from "../../src/ticks.ts";
import type { Hold } from "../../src/status.ts";
import { fault, run, specimen, status, well } from "../support/statuses.ts";

const half = status({
  state: "Execute",
  run: run([well("A01", { outcome: "succeeded" }), well("A02")]),
  specimen: specimen("A02", new Array<number>(11).fill(1)),
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
  assert.equal(progress({ ...half, state: "Held" }), 0.5, "a held run has given its specimen up");
});

test("the line under the sentence says how far, or how it ended", () => {
  assert.equal(progressLine(half), "Run demo-1: 1 of 2 wells done · about 2 min left.");
  const ended = run([well("A01", { outcome: "failed" }), well("A02", { outcome: "skipped" })], { outcome: "failed" });
  assert.equal(progressLine({ ...half, run: ended }), "Run demo-1 failed: 1 skipped, 1 failed.");
  assert.equal(tally(ended), "1 skipped, 1 failed");
  assert.equal(progressLine(status()), "Ready for a run.");
});

test("a held run says why, how often and what to do", () => {
  const hold = {
    code: "rotation_lost",
    cause: "The axis' controller does not answer any more.",
    times: 4,
    next_action: "Check the controller's power and cable, then let the run go on.",
  };
  const held = (change: Partial<Hold> | null) => ({
    ...half,
    state: "Held" as const,
    run: run([well("A01")], { hold: change && { ...hold, ...change } }),
  });
  assert.equal(
    holdLine(held({})),
    "Held because: The axis' controller does not answer any more. It has held the run 4 times since a well was " +
      "finished. What to do: Check the controller's power and cable, then let the run go on.",
  );
  assert.equal(
    holdLine(held({ times: 1, next_action: null })),
    "Held because: The axis' controller does not answer any more. What to do: Nothing: the run goes on by itself.",
  );
  assert.equal(holdLine(held(null)), "");
  assert.equal(holdLine(half), "");
  assert.equal(holdLine(status()), "");
});

test("the tone is that of the worst that is so", () => {
  assert.equal(toneOf(status()), "calm");
  assert.equal(toneOf(half), "busy");
  assert.equal(toneOf({ ...half, faults: [fault()] }), "attention");
  assert.equal(toneOf({ ...half, faults: [fault(), fault({ operator_required: true })] }), "alarm");
  assert.equal(toneOf({ ...half, state: "Held" }), "attention");
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

test("volumes are kept per well until another run starts", () => {
  const history = new VolumeHistory();
  history.take({ ...half, specimen: specimen("A01", [5, 4]) });
  history.take({ ...half, specimen: specimen("A02", []) });
  history.take({ ...half, specimen: specimen("A02", [7]) });
  history.take({ ...half, specimen: null });
  assert.deepEqual(history.of("A01"), [5, 4]);
  assert.deepEqual(history.of("A02"), [7]);
  history.take({ ...half, run: run([well("A01")], { id: "next" }), specimen: null });
  assert.deepEqual(history.of("A01"), []);
  const again = run([well("A01")], { id: "next", started: "2026-03-06T09:30:00Z" });
  history.recall(run([], { id: "next" }), "A01", [9, 8]);
  assert.deepEqual(history.of("A01"), [9, 8]);
  history.take({ ...half, run: again, specimen: null });
  assert.deepEqual(history.of("A01"), [], "another run of the same name");
  assert.equal(history.recall(run([], { id: "next" }), "A01", [9, 8]), false);
});

test("ticks are round and enclose the values", () => {
  assert.deepEqual(logTicks(264.2, 4990), [200, 500, 1000, 2000, 5000]);
  assert.deepEqual(logTicks(65.4, 65.4), [50, 100]);
  assert.deepEqual(logTicks(100, 100), [100, 200]);
  for (let lowest = 0.013; lowest < 1e6; lowest *= 1.37) {
    const ticks = logTicks(lowest, lowest * 30);
    assert.ok(ticks[0]! <= lowest * (1 + 1e-8) && ticks[1]! > lowest, `${ticks} for ${lowest}`);
    assert.ok(ticks.at(-1)! >= lowest * 30 && ticks.at(-2)! < lowest * 30, `${ticks} for ${lowest}`);
    for (const tick of ticks) assert.match(tick.toExponential(), /^[125]e/);
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
