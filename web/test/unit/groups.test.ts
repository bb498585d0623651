import assert from "node:assert/strict";
import { test } from "node:test";
import { pointsOf } from "../../src/beads.ts";
import { resultGroups, summaryOf } from "../../src/groups.ts";
import type { GateRow } from "../../src/status.ts";
import { well } from "../support/statuses.ts";

test("wells are grouped by what was planned, and those without a number are left out", () => {
  const measured = (name: string, nl: number) => well(name, { outcome: "succeeded", volume_um3: nl * 1e6 });
  const results = [measured("A01", 240), measured("A02", 250), well("A03"), measured("A04", 65), measured("A05", 230)];
  const plan = [
    { well: "A01", dpf: 3, compound: "DMSO" },
    { well: "A02", dpf: 3, compound: "DMSO", replicate: 2 },
    { well: "A03", dpf: 3, compound: "DMSO" },
    { well: "A04", specimen: "bead" as const },
    { well: "A05", dpf: 3 },
  ];
  assert.deepEqual(resultGroups(results, plan, "volume"), [
    {
      words: "larva, 3 dpf, DMSO",
      dpf: 3,
      wells: [
        { well: "A01", value: 240 },
        { well: "A02", value: 250 },
      ],
    },
    { words: "bead", dpf: null, wells: [{ well: "A04", value: 65 }] },
    { words: "larva, 3 dpf", dpf: 3, wells: [{ well: "A05", value: 230 }] },
  ]);
  assert.deepEqual(resultGroups(results, plan, "area"), []);
  // Before the plan is read, age and kind are known from the results.
  assert.deepEqual(
    resultGroups(results, [], "volume").map((g) => [g.words, g.wells.length]),
    [["larva, 3 dpf", 4]],
  );
});

test("median and quartiles are those of R's type 7", () => {
  const s = summaryOf([7, 1, 3, 10]);
  assert.deepEqual([s.n, s.least, s.lower, s.median, s.upper, s.most], [4, 1, 2.5, 5, 7.75, 10]);
  assert.equal(s.mean, 5.25);
  assert.ok(Math.abs(s.sd! - 4.031129) < 1e-6);
  assert.deepEqual([summaryOf([4]).sd, summaryOf([4]).lower, summaryOf([4]).upper], [null, 4, 4]);
});

test("a chart has the gates that measured its quantity, with their limits and what is out of them", () => {
  const gate = (day: number, mean: number, change: object = {}): GateRow => ({
    ...{ id: `g${day}`, rig: "vast", mode: "hardware", measured: `2026-03-0${day}T08:00:00Z`, verdict: "passed" },
    ...{ passes: true, beads: 3, nominal_um: 500, begins_history: false },
    quantities: [
      {
        name: "diameter_um",
        mean,
        sd: 0.4,
        history_mean: null,
        lower_limit: null,
        upper_limit: null,
        jumped: false,
        drifted: false,
        ...change,
      },
    ],
  });
  const gates = [gate(1, 500.2), gate(2, 507.1, { lower_limit: 498, upper_limit: 503, jumped: true })];
  const points = pointsOf(gates, "diameter_um");
  assert.deepEqual(
    points.map((p) => [p.id, p.value, p.limits, p.isOut]),
    [
      ["g1", 500.2, null, false],
      ["g2", 507.1, [498, 503], true],
    ],
  );
  assert.match(points[1]!.words, /^2026-03-02 .*: 507\.10 of 3 beads, a jump$/);
  assert.deepEqual(pointsOf(gates, "uy_px"), []);
});
