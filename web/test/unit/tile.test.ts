import assert from "node:assert/strict";
import { test } from "node:test";
import { plateName } from "../../src/plain.ts";
import { tileOf } from "../../src/wall/tile.ts";
import { fault, run, status, well } from "../support/statuses.ts";

const running = status({
  state: "Execute",
  run: run([well("A01", { outcome: "succeeded", volume_um3: 245e6, volume_sd_um3: 2e6 }), well("A02")]),
});

test("a tile has name, state, plate, count, and the numbers of the last well", () => {
  const tile = tileOf("http://a:1", running, null, 1);
  assert.equal(tile.name, running.instrument.name);
  assert.deepEqual([tile.state, tile.needed, tile.tone], ["Running", null, "busy"]);
  assert.equal(tile.plate, plateName(running));
  assert.match(tile.last, /^Last: A01 245\.0\s±\s2\.0\snL/);
});

test("somebody is needed where a fault waits for a person, and where nobody answers", () => {
  const waits = { ...running, faults: [fault({ operator_required: true })] };
  assert.notEqual(tileOf("http://a:1", waits, null, 1).needed, null);
  const silent = tileOf("http://a:1", running, "it does not answer", 60);
  assert.deepEqual([silent.state, silent.tone], ["Silent", "alarm"]);
  assert.match(silent.needed!, /^No answer for 1 min: it does not answer\. What is shown is that old\.$/);
  // A single answer that is late is no alarm, and what was heard before is not shown as the state of now.
  for (const trouble of [null, "it does not answer"]) {
    const late = tileOf("http://a:1", running, trouble, 5);
    assert.deepEqual([late.state, late.needed, late.tone], ["No answer", null, "calm"]);
    assert.match(late.trouble!, /^No answer for 5 s(: it does not answer)?\. What is shown is that old\.$/);
  }
  const waitsLate = tileOf("http://a:1", waits, null, 5);
  assert.deepEqual([waitsLate.state, waitsLate.tone], ["No answer", tileOf("http://a:1", waits, null, 1).tone]);
  assert.notEqual(waitsLate.needed, null, "who was needed is needed still");
  assert.match(tileOf("http://a:1", null, "the token is missing or wrong", 0).needed!, /^No status: the token/);
  assert.equal(tileOf("http://a:1", null, null, 0).needed, null);
});
