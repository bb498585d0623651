import assert from "node:assert/strict";
import { test } from "node:test";
import type { Specimen, WellStatus } from "../../src/status.ts";
import { StoredSpecimens } from "../../src/stored.ts";
import { kept } from "../support/fixture-server.ts";
import { run, well } from "../support/statuses.ts";

test("what is stored is asked for once per run, nothing again after a while", async () => {
  const answers: (Specimen | null | Error)[] = [null, kept(), kept(), new Error("away"), kept()];
  let asked = 0;
  let now = 0;
  const stored = new StoredSpecimens(
    async () => {
      const answer = answers[asked++]!;
      if (answer instanceof Error) throw answer;
      return answer;
    },
    () => now,
  );
  const one = { run: "demo-1", started: "2026-03-05T09:30:00Z", well: "A01" };
  assert.equal(await stored.of(one), null);
  assert.equal(await stored.of(one), null);
  assert.equal(asked, 1, "not with every status");
  now = 60_000;
  assert.equal(await stored.of(one), answers[1]);
  now = 600_000;
  assert.equal(await stored.of(one), answers[1]);
  const again = { ...one, started: "2026-03-06T09:30:00Z" };
  assert.equal(await stored.of(again), answers[2], "another run of the same name");
  const next = { ...one, well: "A02" };
  await assert.rejects(stored.of(next));
  assert.equal(await stored.of(next), answers[4]);
  assert.equal(asked, 5);
});

test("only the newest records are kept, however long the page is open", async () => {
  let asked = 0;
  const stored = new StoredSpecimens(async () => ((asked += 1), kept()));
  const of = (run: number) => stored.of({ run: `r-${run}`, started: "2026-03-05T09:30:00Z", well: "A01" });
  for (let run = 0; run < 100; run += 1) await of(run);
  await of(99);
  assert.equal(asked, 100, "the newest is still there");
  await of(0);
  assert.equal(asked, 101, "the oldest was forgotten, and is read again");
});

test("a well that is measured again has another record", async () => {
  let asked = 0;
  const stored = new StoredSpecimens(async () => ((asked += 1), kept()));
  const one = { run: "demo-1", started: "2026-03-05T09:30:00Z", well: "A01" };
  const seen = (outcome: WellStatus["outcome"]) =>
    stored.see(run([well("A01", { outcome })], { id: one.run, started: one.started }));
  const first = await stored.of(one);
  seen("succeeded");
  assert.equal(await stored.of(one), first);
  seen(null);
  seen("succeeded");
  assert.notEqual(await stored.of(one), first);
  assert.equal(asked, 2);
});
