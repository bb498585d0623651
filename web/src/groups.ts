// The results of a run by the groups of its plate map: each well as a dot, median and quartiles, and the references of its age behind.

import { fetchStatistics, Refused } from "./api.ts";
import { element, setText, show, svg } from "./dom.ts";
import { doseCharts, windowWords } from "./doses.ts";
import { capitalised, grouped, significant, UM3_PER_NL } from "./format.ts";
import { groupsOf, planWords } from "./planplate.ts";
import { standingsOf } from "./standing.ts";
import { runKey, type StoredSpecimens } from "./stored.ts";
import { linearTicks } from "./ticks.ts";
import { Latest } from "./latest.ts";
import type { PlannedWell, RunStatus, Statistics, WellStatus } from "./status.ts";

export type Quantity = "volume" | "area";

interface Shown {
  name: string;
  unit: string;
  /** Its name in the statistics of the daemon, and the size of the unit that is shown in theirs. */
  column: string;
  size: number;
  of: (well: WellStatus) => number | null;
}

const QUANTITIES: Record<Quantity, Shown> = {
  volume: {
    ...{ name: "Volume", unit: "nL", column: "volume_um3", size: UM3_PER_NL },
    of: (w) => (w.volume_um3 === null ? null : w.volume_um3 / UM3_PER_NL),
  },
  area: {
    ...{ name: "Area", unit: "mm²", column: "area_um2", size: 1e6 },
    of: (w) => (w.area_um2 === null ? null : w.area_um2 / 1e6),
  },
};

/** The measured wells of a group. */
export interface ResultGroup {
  words: string;
  /** Days post fertilisation of all its wells; null where they are not known or the group has beads. */
  dpf: number | null;
  wells: { well: string; value: number }[];
}

/** Groups by what the plate map says of the wells; without a plate map by what the results say. Wells without a number are left out. Pure. */
export function resultGroups(
  results: readonly WellStatus[],
  plan: readonly PlannedWell[],
  quantity: Quantity,
): ResultGroup[] {
  const { of } = QUANTITIES[quantity];
  const values = new Map(results.flatMap((w) => (of(w) === null ? [] : [[w.well, of(w)!] as const])));
  const planned = plan.length > 0 ? plan : results.map(({ well, specimen, dpf }) => ({ well, specimen, dpf }));
  return groupsOf(planned)
    .map((group) => ({
      words: planWords(group.wells[0]!),
      dpf: group.wells[0]!.specimen === "bead" ? null : (group.wells[0]!.dpf ?? null),
      wells: group.wells.flatMap(({ well }) => (values.has(well) ? [{ well, value: values.get(well)! }] : [])),
    }))
    .filter((group) => group.wells.length > 0);
}

export interface Summary {
  n: number;
  mean: number;
  /** Divisor n - 1; null of a single value. */
  sd: number | null;
  least: number;
  lower: number;
  median: number;
  upper: number;
  most: number;
}

/** Quartiles are interpolated between the sorted values (R's type 7). Pure. */
export function summaryOf(values: readonly number[]): Summary {
  const sorted = [...values].sort((a, b) => a - b);
  const n = sorted.length;
  const at = (share: number) => {
    const place = share * (n - 1);
    const low = Math.floor(place);
    return sorted[low]! + (place - low) * ((sorted[low + 1] ?? sorted[low]!) - sorted[low]!);
  };
  const mean = sorted.reduce((sum, v) => sum + v, 0) / n;
  const sd = n < 2 ? null : Math.sqrt(sorted.reduce((sum, v) => sum + (v - mean) ** 2, 0) / (n - 1));
  return { n, mean, sd, least: sorted[0]!, lower: at(0.25), median: at(0.5), upper: at(0.75), most: sorted[n - 1]! };
}

/** Reference larvae of an age, in the unit of the chart. */
interface Reference {
  mean: number;
  sd: number;
  n: number;
}

export class GroupsView {
  readonly #panel: HTMLDetailsElement;
  readonly #quantity: HTMLSelectElement;
  readonly #chart: HTMLElement;
  readonly #table: HTMLElement;
  readonly #words: HTMLElement;
  readonly #window: HTMLElement;
  readonly #doses: HTMLElement;
  readonly #stored: StoredSpecimens;
  readonly #choose: (well: string) => void;
  #run: RunStatus | null = null;
  #plan: readonly PlannedWell[] = [];
  #references = new Map<number, Reference>();
  #referencesOf = "";
  #shown = "";
  readonly #ask = new Latest(() => this.#readStatistics());
  #statistics: Statistics | null = null;
  /** Run and measured wells that the statistics are of. */
  #statisticsOf = "";

  constructor(
    find: <T extends Element = HTMLElement>(id: string) => T,
    stored: StoredSpecimens,
    choose: (well: string) => void,
  ) {
    this.#panel = find("groups");
    this.#quantity = find("groups-quantity");
    this.#chart = find("groups-chart");
    this.#table = find("groups-table");
    this.#words = find("groups-words");
    this.#window = find("groups-window");
    this.#doses = find("groups-doses");
    this.#stored = stored;
    this.#choose = choose;
    this.#panel.addEventListener("toggle", () => this.#draw());
    this.#quantity.addEventListener("change", () => this.#draw());
    new ResizeObserver(() => this.#draw()).observe(this.#chart);
  }

  update(run: RunStatus | null, plan: readonly PlannedWell[]): void {
    this.#run = run;
    this.#plan = plan;
    show(this.#panel, run !== null && run.results.some((w) => w.volume_um3 !== null));
    this.#draw();
  }

  #draw(): void {
    const run = this.#run;
    const width = this.#chart.clientWidth;
    if (run === null || !this.#panel.open || width === 0) return;
    const quantity = this.#quantity.value as Quantity;
    const groups = resultGroups(run.results, this.#plan, quantity);
    void this.#readReferences(run, groups, quantity);
    void this.#ask.ask();
    const now = JSON.stringify([groups, [...this.#references], quantity, width, this.#statisticsOf]);
    if (now === this.#shown) return;
    this.#shown = now;
    if (groups.length === 0) {
      this.#chart.replaceChildren(element("p", "quiet", "No well has this number yet."));
      this.#table.replaceChildren();
      setText(this.#words, "");
      return;
    }
    this.#drawStatistics(quantity);
    this.#chart.replaceChildren(picture(groups, this.#references, quantity, width, this.#choose));
    this.#table.replaceChildren(...table(groups, quantity));
    const behind = [...this.#references].map(([dpf, { n }]) => `${n} larvae of ${dpf} dpf`).join(", ");
    setText(
      this.#words,
      "A dot is a well; the box has the median and the quartiles." +
        (behind === "" ? "" : ` Behind: mean ± 1 SD of the references, ${behind}.`),
    );
  }

  /** Reads the statistics of the daemon when another well has a number. */
  async #readStatistics(): Promise<void> {
    const run = this.#run;
    if (run === null || !this.#panel.open) return;
    const of = `${runKey(run)} ${run.results.filter((w) => w.volume_um3 !== null).length}`;
    if (of === this.#statisticsOf) return;
    try {
      this.#statistics = await fetchStatistics(run.id);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.#statistics = null;
    }
    this.#statisticsOf = of;
    this.#draw();
  }

  #drawStatistics(quantity: Quantity): void {
    const { unit, column, size } = QUANTITIES[quantity];
    const found = this.#statistics?.quantities.find(({ name }) => name === column);
    setText(this.#window, found === undefined ? "" : windowWords(found));
    this.#doses.replaceChildren(...(found === undefined ? [] : doseCharts(found, size, unit, this.#choose)));
  }

  /** The references of each age, from the first measured larva of that age. */
  async #readReferences(run: RunStatus, groups: readonly ResultGroup[], quantity: Quantity): Promise<void> {
    const of = `${runKey(run)} ${quantity} ${groups.map((g) => g.dpf).join()}`;
    if (of === this.#referencesOf) return;
    this.#referencesOf = of;
    const found = new Map<number, Reference>();
    for (const { dpf, wells } of groups) {
      if (dpf === null || found.has(dpf)) continue;
      const one = { run: run.id, started: run.started, well: wells[0]!.well };
      const kept = await this.#stored.of(one).catch(() => null);
      const standing = standingsOf(kept?.measurement ?? null, kept?.result?.estimator ?? null);
      const known = standing.find((s) => s.quantity === QUANTITIES[quantity].name);
      if (known) found.set(dpf, { mean: known.mean, sd: known.sd, n: known.n });
    }
    // Another run or quantity was chosen meanwhile.
    if (of !== this.#referencesOf) return;
    this.#references = found;
    this.#draw();
  }
}

const MARGIN = { left: 58, right: 12, top: 12, bottom: 34 };
const HEIGHT = 300;
/** Distance of neighbouring dots across, px: dots of like values do not cover each other. */
const APART_PX = 7;

function picture(
  groups: readonly ResultGroup[],
  references: ReadonlyMap<number, Reference>,
  quantity: Quantity,
  width: number,
  choose: (well: string) => void,
): SVGElement {
  const { name, unit } = QUANTITIES[quantity];
  const behind = groups.map((g) => (g.dpf === null ? undefined : references.get(g.dpf)));
  const all = groups.flatMap((g) => g.wells.map((w) => w.value));
  for (const r of behind) if (r) all.push(r.mean - r.sd, r.mean + r.sd);
  const levels = linearTicks(Math.min(...all), Math.max(...all));
  const [low, high] = [levels[0]!, levels.at(-1)!];
  const digits = Math.max(0, -Math.floor(Math.log10(levels[1]! - low) + 1e-9));
  const bottom = HEIGHT - MARGIN.bottom;
  const y = (value: number) => bottom - ((value - low) / (high - low)) * (bottom - MARGIN.top);
  const slot = (width - MARGIN.left - MARGIN.right) / groups.length;
  const label = `${name} of ${grouped(all.length)} wells in ${grouped(groups.length)} groups; the table below has the numbers`;
  const chart = svg("svg", {
    width,
    height: HEIGHT,
    viewBox: `0 0 ${width} ${HEIGHT}`,
    role: "img",
    "aria-label": label,
  });
  chart.dataset["groups"] = String(groups.length);
  for (const level of levels) {
    chart.append(
      svg("line", { class: "grid", x1: MARGIN.left, x2: width - MARGIN.right, y1: y(level), y2: y(level) }),
      svg("text", { class: "tick", x: MARGIN.left - 8, y: y(level) + 4, "text-anchor": "end" }, grouped(level, digits)),
    );
  }
  const middle = (MARGIN.top + bottom) / 2;
  const turned = `rotate(-90 14 ${middle})`;
  chart.append(
    svg("text", { class: "title", x: 14, y: middle, transform: turned, "text-anchor": "middle" }, `${name}, ${unit}`),
  );
  groups.forEach((group, i) => {
    const x = MARGIN.left + (i + 0.5) * slot;
    const half = Math.min(34, 0.4 * slot);
    const r = behind[i];
    if (r) {
      const [top, base] = [y(r.mean + r.sd), y(r.mean - r.sd)];
      const band = { x: x - 0.48 * slot, width: 0.96 * slot };
      chart.append(svg("rect", { class: "groups-reference", ...band, y: top, height: base - top }));
      chart.append(
        svg("line", { class: "groups-mean", x1: band.x, x2: band.x + band.width, y1: y(r.mean), y2: y(r.mean) }),
      );
    }
    const s = summaryOf(group.wells.map((w) => w.value));
    const box = { x: x - half, width: 2 * half, y: y(s.upper), height: Math.max(1, y(s.lower) - y(s.upper)) };
    chart.append(svg("rect", { class: "groups-box", ...box }));
    chart.append(svg("line", { class: "groups-median", x1: x - half, x2: x + half, y1: y(s.median), y2: y(s.median) }));
    for (const { well, value, shift } of spread(group.wells, y, half)) {
      const dot = svg("circle", { class: "groups-dot", cx: x + shift, cy: y(value), r: 3.5 });
      dot.dataset["well"] = well;
      dot.append(svg("title", {}, `${well}: ${significant(value)} ${unit}`));
      dot.addEventListener("click", () => choose(well));
      chart.append(dot);
    }
    chart.append(svg("text", { class: "tick", x, y: bottom + 20, "text-anchor": "middle" }, letter(i)));
  });
  chart.append(svg("line", { class: "axis", x1: MARGIN.left, x2: width - MARGIN.right, y1: bottom, y2: bottom }));
  return chart;
}

function letter(group: number): string {
  return group < 26 ? String.fromCharCode(97 + group) : String(group + 1);
}

/** Places dots beside each other where their values are alike. */
function spread(
  wells: ResultGroup["wells"],
  y: (value: number) => number,
  half: number,
): { well: string; value: number; shift: number }[] {
  const rows = new Map<number, number>();
  return [...wells]
    .sort((a, b) => a.value - b.value)
    .map(({ well, value }) => {
      const row = Math.round(y(value) / APART_PX);
      const count = rows.get(row) ?? 0;
      rows.set(row, count + 1);
      const shift = Math.ceil(count / 2) * APART_PX * (count % 2 === 0 ? 1 : -1);
      return { well, value, shift: Math.max(-half, Math.min(half, shift)) };
    });
}

function table(groups: readonly ResultGroup[], quantity: Quantity): HTMLElement[] {
  const { name, unit } = QUANTITIES[quantity];
  const heads = ["Mark", "Group", "Wells", `Median, ${unit}`, `Mean, ${unit}`, "SD", "Least", "Most"];
  const head = element("tr", "", ...heads.map((words) => element("th", "", words)));
  const rows = groups.map((group, i) => {
    const s = summaryOf(group.wells.map((w) => w.value));
    const numbers = [s.median, s.mean, s.sd, s.least, s.most].map((v) => (v === null ? "–" : significant(v)));
    const cells = [letter(i), capitalised(group.words), grouped(s.n), ...numbers];
    return element("tr", "", ...cells.map((words) => element("td", "", words)));
  });
  return [element("caption", "", `${name} by group`), element("thead", "", head), element("tbody", "", ...rows)];
}
