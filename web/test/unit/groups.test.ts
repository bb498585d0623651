import assert from "node:assert/strict";
import { test } from "node:test";
import { pointsOf } from "../../src/beads.ts";
import { response, responseWords, windowWords } from "../../src/doses.ts";
import { resultGroups, summaryOf } from "../../src/groups.ts";
import type { DoseSeries, GateRow } from "../../src/status.ts";
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

const fitted = (value: number) => ({ value, sd: 0.1, interval_95: { low: value - 0.2, high: value + 0.2 } });
const series: DoseSeries = {
  condition: {
    ...{ specimen: "larva", dpf: 3, strain: null, treatment: null, compound: "BPA" },
    ...{ concentration: null, concentration_unit: null, control: null },
  },
  concentration_unit: "uM",
  points: [{ run: "r", well: "A01", dose: 0, value: 240 }],
  curve: {
    ...{ at_zero: fitted(240), at_infinity: fitted(180), hill: fitted(1.5), log10_ec50: fitted(0.5) },
    ...{ ec50: 3.16, ec50_interval_95: { low: 2, high: 5 }, ec50_is_within_doses: true },
    ...{ p_no_effect: 0.0012, residual_sd: 3 },
  },
  reason: null,
};

test("a curve has its ends at no dose and at a large one, and half of the effect at its EC50", () => {
  const curve = series.curve!;
  assert.equal(response(curve, 0), 240);
  assert.equal(response(curve, curve.ec50), 210);
  assert.ok(Math.abs(response(curve, 1e9) - 180) < 1e-3);
});

test("a response says its EC50 with its interval, or why there is no curve; controls say their Z'", () => {
  assert.equal(
    responseWords(series),
    "BPA, larva, 3 dpf: EC50 3.16 uM (95 %: 2.00 to 5.00); Hill 1.50; p of no effect 0.0012.",
  );
  const beyond = { ...series, curve: { ...series.curve!, ec50_is_within_doses: false } };
  assert.match(responseWords(beyond), /beyond the doses: an extrapolation;/);
  assert.equal(
    responseWords({ ...series, curve: null, reason: "two doses; four are needed" }),
    "BPA, larva, 3 dpf: no curve, two doses; four are needed (1 well).",
  );
  const window = { run: "r", positive: 4, negative: 6 };
  assert.equal(
    windowWords({ windows: [{ ...window, z_prime: 0.618, reason: null }] }),
    "Z' of the controls: 0.62 (4 positive, 6 negative).",
  );
  assert.equal(
    windowWords({ windows: [{ ...window, positive: 0, z_prime: null, reason: "no positive control" }] }),
    "No Z' (0 positive, 6 negative): no positive control.",
  );
  assert.equal(windowWords({ windows: [] }), "");
});
