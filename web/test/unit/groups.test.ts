import assert from "node:assert/strict";
import { test } from "node:test";
import { pointsOf } from "../../src/beads.ts";
import { responseWords, windowWords } from "../../src/doses.ts";
import { larvaGroups, leftOutWords, referenceWords } from "../../src/groups.ts";
import type { DoseSeries, GateRow, WellGroup } from "../../src/status.ts";

const group = (specimen: string, reference: WellGroup["reference"]): WellGroup => ({
  ...{ condition: { ...series.condition, specimen }, n: 1, left_out: 0, mean: 240e6, sd: null, mean_interval_95: null },
  ...{ median: 240e6, mad: 0, reference, values: [{ run: "r", well: "A01", value: 240e6, flagged: false }] },
});

test("groups are those of larvae, and each reference behind them is named once", () => {
  const known = { group: "fixed, 3 dpf", n: 12, interval_95: { low: 220e6, high: 260e6 } };
  const groups = [group("larva", known), group("bead", null), group("larva", null), group("larva", known)];
  const larvae = larvaGroups({ groups });
  assert.deepEqual(larvae, [groups[0], groups[2], groups[3]]);
  assert.deepEqual(larvaGroups(undefined), []);
  const other = { ...known, group: "fixed, 5 dpf", n: 1 };
  assert.equal(referenceWords([...larvae, group("larva", other)]), "12 larvae (fixed, 3 dpf), 1 larva (fixed, 5 dpf)");
  assert.equal(referenceWords([group("larva", null)]), "");
});

test("what does not count is said with its reasons", () => {
  const out = (well: string, ...flags: string[]) => ({ run: "r", well, value: 1, failed: false, flags });
  assert.equal(leftOutWords(undefined), "");
  assert.equal(leftOutWords({ left_out: [] }), "");
  assert.equal(
    leftOutWords({ left_out: [out("A01", "clipped_left", "moved"), out("A02", "moved")] }),
    "2 wells are left out: 1 because its number is a bound (clipped left), 1 because its number is doubtful (moved).",
  );
  assert.equal(leftOutWords({ left_out: [out("A01", "excluded")] }), "1 well is left out: 1 by a person.");
  const failed = [
    { ...out("A01"), failed: true },
    { ...out("A02", "moved"), failed: true },
  ];
  assert.equal(
    leftOutWords({ left_out: [out("A03", "excluded"), ...failed] }),
    "3 wells are left out: 1 by a person, 2 because they did not succeed.",
  );
  const bounds = [out("A02", "moved", "outside_box"), out("A03", "clipped_left", "outside_box")];
  const doubtful = [out("A04", "residual", "moved"), out("A05", "moved")];
  assert.equal(
    leftOutWords({ left_out: [...doubtful, ...bounds, out("A01", "moved", "excluded")] }),
    "5 wells are left out: 1 by a person, 2 because their numbers are bounds (clipped left, outside box), " +
      "2 because their numbers are doubtful (moved, residual).",
  );
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
  const limits = { lower_limit: 498, upper_limit: 503 };
  const gates = [
    gate(1, 500.2, { lower_limit: 498 }),
    gate(2, 507.1, { ...limits, jumped: true }),
    gate(3, 502.1, { ...limits, drifted: true }),
  ];
  const points = pointsOf(gates, "diameter_um");
  assert.deepEqual(
    points.map((p) => [p.id, p.value, p.limits, p.isOut]),
    [
      ["g1", 500.2, null, false],
      ["g2", 507.1, [498, 503], true],
      ["g3", 502.1, [498, 503], true],
    ],
  );
  assert.match(points[0]!.words, /: 500\.20 of 3 beads$/);
  assert.match(points[2]!.words, /: 502\.10 of 3 beads, a drift$/);
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
    ...{ p_no_effect: 0.0012, residual_sd: 3, line: [] },
  },
  reason: null,
};

test("a response says its EC50 with its interval, or why there is no curve; controls say their Z'", () => {
  assert.equal(
    responseWords(series),
    "BPA, larva, 3 dpf: EC50 3.16 µM (95 %: 2.00 to 5.00); Hill 1.50; p of no effect 0.0012.",
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
