// Control charts of the beads: each quantity of the daily gates over time, with the limits that the earlier gates gave it. A jump is outside
// of the limits; a drift is a cumulative sum over its limit. docs/quality.md explains both.

import { fetchGates, Refused } from "./api.ts";
import { element, setText, show, svg } from "./dom.ts";
import { counted, day, grouped } from "./format.ts";
import { levelDigits, linearTicks } from "./ticks.ts";
import type { GateRow } from "./status.ts";

const QUANTITIES: Record<string, { name: string; digits: number }> = {
  diameter_um: { name: "Mean diameter, µm", digits: 2 },
  aspect_ratio: { name: "Length over width (ky over kx)", digits: 4 },
  sphere_rms_um: { name: "Distance from a sphere, µm", digits: 2 },
  residual_px: { name: "Edges from what other views expect, px", digits: 3 },
  uy_px: { name: "Axis, row of the picture, px", digits: 2 },
  gamma_deg: { name: "Roll of the axis, deg", digits: 3 },
};

export interface ChartPoint {
  id: string;
  time: number;
  value: number;
  sd: number | null;
  limits: [number, number] | null;
  isOut: boolean;
  words: string;
}

/** The points of a quantity, oldest first. Pure. */
export function pointsOf(gates: readonly GateRow[], quantity: string): ChartPoint[] {
  return gates.flatMap((gate) => {
    const found = gate.quantities.find(({ name }) => name === quantity);
    if (found === undefined) return [];
    const digits = QUANTITIES[quantity]?.digits ?? 3;
    const { lower_limit: lower, upper_limit: upper } = found;
    const limits: [number, number] | null = lower === null || upper === null ? null : [lower, upper];
    const why = found.jumped ? ", a jump" : found.drifted ? ", a drift" : "";
    const words = `${day(gate.measured)}: ${grouped(found.mean, digits)} of ${counted(gate.beads, "bead")}${why}`;
    const isOut = found.jumped || found.drifted;
    return [{ id: gate.id, time: Date.parse(gate.measured), value: found.mean, sd: found.sd, limits, isOut, words }];
  });
}

export class BeadCharts {
  readonly #panel: HTMLDetailsElement;
  readonly #rig: HTMLSelectElement;
  readonly #choice: HTMLElement;
  readonly #words: HTMLElement;
  readonly #charts: HTMLElement;
  #gates: GateRow[] = [];

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#panel = find("beads");
    this.#rig = find("beads-rig");
    this.#choice = find("beads-choice");
    this.#words = find("beads-words");
    this.#charts = find("beads-charts");
    this.#panel.addEventListener("toggle", () => {
      if (this.#panel.open) void this.#read();
    });
    this.#rig.addEventListener("change", () => this.#draw());
  }

  async #read(): Promise<void> {
    try {
      this.#gates = await fetchGates();
      const rigs = [...new Set(this.#gates.map((gate) => `${gate.rig} (${gate.mode})`))];
      const chosen = this.#rig.value;
      show(this.#choice, rigs.length > 0);
      this.#rig.replaceChildren(
        ...rigs.map((name) => {
          const option = element("option", "", name);
          option.value = name;
          option.selected = name === chosen;
          return option;
        }),
      );
      this.#draw();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      setText(this.#words, `The bead gates could not be read: ${error.message}.`);
    }
  }

  #draw(): void {
    const gates = this.#gates.filter((gate) => `${gate.rig} (${gate.mode})` === this.#rig.value);
    const newest = gates.at(-1);
    setText(
      this.#words,
      newest === undefined
        ? "No beads were measured yet. A run with three beads or more makes a gate."
        : `${counted(gates.length, "gate")}. The newest, of ${day(newest.measured)}, ${newest.passes ? "passed" : "did not pass"}.`,
    );
    this.#charts.replaceChildren(
      ...Object.entries(QUANTITIES).flatMap(([quantity, { name, digits }]) => {
        const points = pointsOf(gates, quantity);
        if (points.length === 0) return [];
        const caption = element("figcaption", "caption", `${name}: ${points.at(-1)!.words}.`);
        return [element("figure", "bead-chart", controlChart(name, digits, points), caption)];
      }),
    );
  }
}

const [WIDTH, HEIGHT] = [420, 170];
const MARGIN = { left: 66, right: 12, top: 10, bottom: 26 };

function controlChart(name: string, digits: number, points: readonly ChartPoint[]): SVGElement {
  const ends = points.flatMap((p) => [p.value - (p.sd ?? 0), p.value + (p.sd ?? 0), ...(p.limits ?? [])]);
  const levels = linearTicks(Math.min(...ends), Math.max(...ends));
  const [low, high] = [levels[0]!, levels.at(-1)!];
  // Few gates may differ by less than the decimals of their numbers.
  const decimals = Math.max(digits, levelDigits(levels));
  const [first, last] = [points[0]!.time, points.at(-1)!.time];
  const [right, bottom] = [WIDTH - MARGIN.right, HEIGHT - MARGIN.bottom];
  const x = (time: number) =>
    MARGIN.left + 8 + (last > first ? (time - first) / (last - first) : 0.5) * (right - MARGIN.left - 16);
  const y = (value: number) => bottom - ((value - low) / (high - low)) * (bottom - MARGIN.top);
  const out = points.filter((p) => p.isOut).length;
  const label = `${name} of ${counted(points.length, "gate")}, ${out} outside of the limits`;
  const chart = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label });
  chart.dataset["points"] = String(points.length);
  chart.dataset["out"] = String(out);
  for (const level of levels) {
    chart.append(
      svg("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(level), y2: y(level) }),
      svg(
        "text",
        { class: "tick", x: MARGIN.left - 6, y: y(level) + 4, "text-anchor": "end" },
        grouped(level, decimals),
      ),
    );
  }
  for (const side of [0, 1] as const) {
    const line = points.flatMap((p) => (p.limits ? [`${x(p.time).toFixed(1)},${y(p.limits[side]).toFixed(1)}`] : []));
    if (line.length > 0) chart.append(svg("polyline", { class: "bead-limit", points: line.join(" ") }));
  }
  const way = points.map((p) => `${x(p.time).toFixed(1)},${y(p.value).toFixed(1)}`).join(" ");
  chart.append(svg("polyline", { class: "bead-line", points: way }));
  for (const p of points) {
    const at = x(p.time);
    if (p.sd !== null) {
      chart.append(svg("line", { class: "bead-sd", x1: at, x2: at, y1: y(p.value - p.sd), y2: y(p.value + p.sd) }));
    }
    // A point outside of the limits has another shape, too.
    const dot = p.isOut
      ? svg("rect", { class: "bead-out", x: at - 5, y: y(p.value) - 5, width: 10, height: 10 })
      : svg("circle", { class: "bead-dot", cx: at, cy: y(p.value), r: 4 });
    dot.append(svg("title", {}, p.words));
    chart.append(dot);
  }
  for (const [time, anchor] of last > first
    ? ([
        [first, "start"],
        [last, "end"],
      ] as const)
    : ([[first, "middle"]] as const)) {
    const words = day(new Date(time).toISOString()).slice(0, 10);
    chart.append(svg("text", { class: "tick", x: x(time), y: HEIGHT - 8, "text-anchor": anchor }, words));
  }
  return chart;
}
