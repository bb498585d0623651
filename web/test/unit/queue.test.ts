// The order of the queue after a plate was moved.

import assert from "node:assert/strict";
import { test } from "node:test";
import { moved } from "../../src/queue.ts";

test("a plate moves by one place, and not beyond the ends", () => {
  const runs = ["a", "b", "c"];
  assert.deepEqual(moved(runs, "b", -1), ["b", "a", "c"]);
  assert.deepEqual(moved(runs, "b", 1), ["a", "c", "b"]);
  assert.deepEqual(moved(runs, "a", -1), runs);
  assert.deepEqual(moved(runs, "c", 1), runs);
  assert.deepEqual(runs, ["a", "b", "c"], "the list itself stays");
});
