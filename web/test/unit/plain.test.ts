import assert from "node:assert/strict";
import { test } from "node:test";
import { VolumeHistory } from "../../src/history.ts";
import { Latest } from "../../src/latest.ts";
import { canAbort, progress, progressLine, tally, toneOf } from "../../src/plain.ts";
import { niceTicks, roundBelow, viewTicks } from "../../src/ticks.ts";
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
});

test("the line under the sentence says how far, or how it ended", () => {
  assert.equal(
    progressLine(half),
    "Run demo-1: 1 of 2 wells done · A02 taking views, view 11 of 22 · about 2 min left.",
  );
  const ended = run([well("A01", { outcome: "failed" }), well("A02", { outcome: "skipped" })], { outcome: "failed" });
  assert.equal(progressLine({ ...half, run: ended }), "Run demo-1 failed: 1 skipped, 1 failed.");
  assert.equal(tally(ended), "1 skipped, 1 failed");
  assert.equal(progressLine(status()), "Ready for a run.");
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
});

test("ticks are round, reach the highest value and stay few", () => {
  assert.deepEqual(niceTicks(890, 5), [0, 200, 400, 600, 800, 1000]);
  assert.deepEqual(niceTicks(65.4, 5), [0, 20, 40, 60, 80]);
  assert.deepEqual(niceTicks(0, 5), [0, 1]);
  for (let highest = 0.013; highest < 1e6; highest *= 1.37) {
    const ticks = niceTicks(highest, 5);
    const step = ticks[1]!;
    assert.ok(
      [1, 2, 5].some((lead) => Math.abs(lead * 10 ** Math.floor(Math.log10(step * 1.0001)) - step) < step * 1e-9),
    );
    assert.ok(ticks.at(-1)! >= highest * (1 - 1e-9) && ticks.at(-2)! < highest, `${ticks} for ${highest}`);
    assert.ok(ticks.length >= 3 && ticks.length <= 7, `${ticks.length} for ${highest}`);
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
