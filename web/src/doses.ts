// Z' of a run's controls, and the response of each compound to its dose, as the daemon computes them.

import { element, svg } from "./dom.ts";
import { asEntered, counted, grouped, significant, unitWords } from "./format.ts";
import { levelDigits, linearTicks } from "./ticks.ts";
import type { DoseSeries, QuantityStatistics } from "./status.ts";

/** `Z' of the controls: 0.62 (4 positive, 6 negative).`, or why there is none; empty without controls. Pure. */
export function windowWords({ windows }: Pick<QuantityStatistics, "windows">): string {
  return windows
    .map(({ z_prime: z, positive, negative, reason }) => {
      const of = `${positive} positive, ${negative} negative`;
      return z === null
        ? `No Z' (${of}): ${reason ?? "no reason given"}.`
        : `Z' of the controls: ${grouped(z, 2)} (${of}).`;
    })
    .join(" ");
}

/** What a curve says, or why there is none. Pure. */
export function responseWords({ condition, concentration_unit, points, curve, reason }: DoseSeries): string {
  const unit = unitWords(concentration_unit);
  const { compound, specimen, dpf } = condition;
  const name = [compound ?? "no compound", specimen, dpf === null ? "" : `${dpf} dpf`]
    .filter((p) => p !== "")
    .join(", ");
  if (curve === null) return `${name}: no curve, ${reason ?? "no reason given"} (${counted(points.length, "well")}).`;
  const { low, high } = curve.ec50_interval_95;
  const beyond = curve.ec50_is_within_doses ? "" : ", beyond the doses: an extrapolation";
  const ec50 = `EC50 ${significant(curve.ec50, 3)} ${unit} (95 %: ${significant(low, 3)} to ${significant(high, 3)})${beyond}`;
  return `${name}: ${ec50}; Hill ${grouped(curve.hill.value, 2)}; p of no effect ${significant(curve.p_no_effect, 2)}.`;
}

const [WIDTH, HEIGHT] = [420, 220];
const MARGIN = { left: 68, right: 14, top: 12, bottom: 40 };

/** What a chart shows: a quantity by name, its unit, and the size of this unit in that of the statistics. */
export interface Measure {
  name: string;
  unit: string;
  size: number;
}

/** A chart per compound. */
export function doseCharts(of: QuantityStatistics, shown: Measure, choose: (well: string) => void): Node[] {
  return of.responses.map((series) =>
    element(
      "figure",
      "bead-chart",
      chart(series, shown, choose),
      element("figcaption", "caption", responseWords(series)),
    ),
  );
}

function chart(series: DoseSeries, { name, unit, size }: Measure, choose: (well: string) => void): SVGElement {
  const { points, curve } = series;
  const of = unitWords(series.concentration_unit);
  const positive = points.map((p) => p.dose).filter((dose) => dose > 0);
  const [least, most] = [Math.min(...positive), Math.max(...positive)];
  const logs = [Math.log10(least), Math.log10(most)] as const;
  const [right, bottom] = [WIDTH - MARGIN.right, HEIGHT - MARGIN.bottom];
  // A dose of 0 has no logarithm: its wells stand apart at the left.
  const start = MARGIN.left + 44;
  const x = (dose: number) =>
    dose === 0
      ? MARGIN.left + 16
      : start + (logs[1] > logs[0] ? (Math.log10(dose) - logs[0]) / (logs[1] - logs[0]) : 0.5) * (right - start - 8);
  const line = curve?.line ?? [];
  const values = [...points, ...line].map((p) => p.value / size);
  const levels = linearTicks(Math.min(...values), Math.max(...values));
  const [low, high] = [levels[0]!, levels.at(-1)!];
  const digits = levelDigits(levels);
  const y = (value: number) => bottom - ((value - low) / (high - low)) * (bottom - MARGIN.top);
  const label = `Response to ${series.condition.compound ?? "the dose"}, ${counted(points.length, "well")}`;
  const made = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label });
  made.dataset["wells"] = String(points.length);
  for (const level of levels) {
    made.append(
      svg("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(level), y2: y(level) }),
      svg("text", { class: "tick", x: MARGIN.left - 6, y: y(level) + 4, "text-anchor": "end" }, grouped(level, digits)),
    );
  }
  for (const dose of [...new Set(points.map((p) => p.dose))]) {
    made.append(svg("text", { class: "tick", x: x(dose), y: bottom + 16, "text-anchor": "middle" }, asEntered(dose)));
  }
  made.append(
    svg("text", { class: "title", x: (start + right) / 2, y: HEIGHT - 6, "text-anchor": "middle" }, `Dose, ${of}`),
  );
  const middle = (MARGIN.top + bottom) / 2;
  const upwards = { x: 12, y: middle, transform: `rotate(-90 12 ${middle})`, "text-anchor": "middle" };
  made.append(svg("text", { class: "title", ...upwards }, `${name}, ${unit}`));
  if (curve !== null) {
    // As far as the axis goes: an EC50 beyond the doses is an extrapolation.
    const within = (dose: number) => x(Math.min(Math.max(dose, least), most));
    const [from, to] = [within(curve.ec50_interval_95.low), within(curve.ec50_interval_95.high)];
    const height = bottom - MARGIN.top;
    made.append(svg("rect", { class: "dose-interval", x: from, y: MARGIN.top, width: to - from, height }));
    if (curve.ec50 >= least && curve.ec50 <= most) {
      const at = x(curve.ec50);
      made.append(svg("line", { class: "dose-ec50", x1: at, x2: at, y1: MARGIN.top, y2: bottom }));
    }
    // The axis shows the wells and the curve. A wide band leaves it.
    const spot = (dose: number, value: number) =>
      `${x(dose).toFixed(1)},${y(Math.min(Math.max(value / size, low), high)).toFixed(1)}`;
    const upper = line.map((p) => spot(p.dose, p.interval_95.high));
    const lower = line.map((p) => spot(p.dose, p.interval_95.low)).reverse();
    made.append(
      svg("polygon", { class: "dose-band", points: [...upper, ...lower].join(" ") }),
      svg("polyline", { class: "dose-curve", points: line.map((p) => spot(p.dose, p.value)).join(" ") }),
    );
  }
  for (const { well, dose, value } of points) {
    const dot = svg("circle", { class: "groups-dot", cx: x(dose), cy: y(value / size), r: 4 });
    dot.dataset["well"] = well;
    dot.append(svg("title", {}, `${well}: ${significant(value / size)} ${unit} at ${asEntered(dose)} ${of}`));
    dot.addEventListener("click", () => choose(well));
    made.append(dot);
  }
  return made;
}
