// The results of a run by the groups of its plate map, with the numbers of the daemon's statistics: each larva as a dot, the mean with its
// interval, and the references of its age behind. `carved report` draws the same numbers.

import { fetchStatistics, Refused } from "./api.ts";
import { element, setText, show, svg } from "./dom.ts";
import { doseCharts, windowWords } from "./doses.ts";
import { FLAGS } from "./flags.ts";
import { capitalised, counted, grouped, significant, UM3_PER_NL, words as spaced } from "./format.ts";
import { Latest } from "./latest.ts";
import type { Interval, QuantityStatistics, RunStatus, Statistics, WellGroup, WellValue } from "./status.ts";
import { runKey } from "./stored.ts";
import { levelDigits, linearTicks } from "./ticks.ts";
import { planWords } from "./treatment.ts";

export type Quantity = "volume" | "area" | "length" | "eye" | "bladder";

interface Shown {
  name: string;
  unit: string;
  /** Its name in the statistics of the daemon, and the size of the unit that is shown in theirs. */
  column: string;
  size: number;
}

const QUANTITIES: Record<Quantity, Shown> = {
  volume: { name: "Volume", unit: "nL", column: "volume_um3", size: UM3_PER_NL },
  area: { name: "Area", unit: "mm²", column: "area_um2", size: 1e6 },
  length: { name: "Length", unit: "mm", column: "body_length_um", size: 1000 },
  bladder: { name: "Swim bladder volume", unit: "nL", column: "bladder_volume_um3", size: UM3_PER_NL },
  eye: { name: "Eye volume", unit: "nL", column: "eye_volume_um3", size: UM3_PER_NL },
};

/** The groups of larvae, as in the report. Beads have charts of their own. Pure. */
export function larvaGroups(found: Pick<QuantityStatistics, "groups"> | undefined): WellGroup[] {
  return (found?.groups ?? []).filter(({ condition }) => condition.specimen === "larva");
}

/** The reference larvae behind the groups: `12 larvae (fixed, 3 dpf)`. Empty without any. Pure. */
export function referenceWords(groups: readonly WellGroup[]): string {
  const words = groups.flatMap(({ reference: r }) =>
    r === null ? [] : [`${counted(r.n, "larva", "larvae")} (${r.group})`],
  );
  return [...new Set(words)].join(", ");
}

/** Why a well does not count. The first that holds is told. */
const REASONS = [
  { holds: (flag: string) => flag === "excluded", one: "by a person", many: "by a person" },
  { holds: () => false, one: "because it did not succeed", many: "because they did not succeed" },
  {
    holds: (flag: string) => FLAGS[flag]?.effect === "bound",
    one: "because its number is a bound",
    many: "because their numbers are bounds",
  },
  { holds: () => true, one: "because its number is doubtful", many: "because their numbers are doubtful" },
];

/** The place of a well that did not succeed, whatever its flags are, in {@link REASONS}. */
const FAILED = 1;

/**
 * How many wells do not count, and why: `3 wells are left out: 1 by a person, 2 because their numbers are doubtful (moved).` Each counts once.
 * Empty where all count. Pure.
 */
export function leftOutWords(found: Pick<QuantityStatistics, "left_out"> | undefined): string {
  const wells = found?.left_out ?? [];
  if (wells.length === 0) return "";
  const reasonOf = (flag: string) => REASONS.findIndex(({ holds }) => holds(flag));
  const why = REASONS.flatMap(({ one, many }, reason) => {
    const own = wells.filter(
      ({ flags, failed }) => Math.min(...flags.map(reasonOf), ...(failed ? [FAILED] : [])) === reason,
    );
    if (own.length === 0) return [];
    const flags = new Set(own.flatMap(({ flags }) => flags.filter((flag) => reasonOf(flag) === reason)));
    const named = reason <= FAILED ? "" : ` (${[...flags].sort().map(spaced).join(", ")})`;
    return `${grouped(own.length)} ${own.length === 1 ? one : many}${named}`;
  });
  return `${counted(wells.length, "well")} ${wells.length === 1 ? "is" : "are"} left out: ${why.join(", ")}.`;
}

/** What the statistics follow from: the wells with a number, and their flags. When it changes, they are read again. Pure. */
function measuredOf(run: RunStatus): string {
  const numbers = run.results.map(
    ({ well, volume_um3, outcome, flags }) => [well, volume_um3, outcome, flags] as const,
  );
  return JSON.stringify([runKey(run), numbers.filter(([, volume_um3]) => volume_um3 !== null)]);
}

export class GroupsView {
  readonly #panel: HTMLDetailsElement;
  readonly #quantity: HTMLSelectElement;
  readonly #chart: HTMLElement;
  readonly #table: HTMLElement;
  readonly #words: HTMLElement;
  readonly #window: HTMLElement;
  readonly #doses: HTMLElement;
  readonly #choose: (well: string) => void;
  readonly #ask = new Latest(() => this.#read());
  #run: RunStatus | null = null;
  #statistics: Statistics | null = null;
  /** Run and numbers that the statistics are of. */
  #statisticsOf = "";
  /** Why there are no statistics; empty while they are read. */
  #refused = "";
  #shown = "";

  constructor(find: <T extends Element = HTMLElement>(id: string) => T, choose: (well: string) => void) {
    this.#panel = find("groups");
    this.#quantity = find("groups-quantity");
    this.#chart = find("groups-chart");
    this.#table = find("groups-table");
    this.#words = find("groups-words");
    this.#window = find("groups-window");
    this.#doses = find("groups-doses");
    this.#choose = choose;
    this.#panel.addEventListener("toggle", () => this.#draw());
    this.#quantity.addEventListener("change", () => this.#draw());
    new ResizeObserver(() => this.#draw()).observe(this.#chart);
  }

  update(run: RunStatus | null): void {
    const key = run === null ? "" : runKey(run);
    if (key !== (this.#run === null ? "" : runKey(this.#run))) {
      this.#statistics = null;
      this.#statisticsOf = this.#refused = "";
    }
    this.#run = run;
    show(this.#panel, run !== null && run.results.some((w) => w.volume_um3 !== null));
    this.#draw();
  }

  #draw(): void {
    const width = this.#chart.clientWidth;
    if (this.#run === null || !this.#panel.open || width === 0) return;
    void this.#ask.ask();
    const quantity = this.#quantity.value as Quantity;
    const now = JSON.stringify([this.#statistics, this.#refused, quantity, width]);
    if (now === this.#shown) return;
    this.#shown = now;
    const { column } = QUANTITIES[quantity];
    const found = this.#statistics?.quantities.find(({ name }) => name === column);
    const groups = larvaGroups(found);
    setText(this.#window, found === undefined ? "" : windowWords(found));
    this.#doses.replaceChildren(...(found === undefined ? [] : doseCharts(found, QUANTITIES[quantity], this.#choose)));
    setText(this.#words, this.#sentence(found, groups));
    if (groups.length === 0) {
      this.#chart.replaceChildren();
      this.#table.replaceChildren();
      return;
    }
    this.#chart.replaceChildren(picture(groups, QUANTITIES[quantity], width, this.#choose));
    this.#table.replaceChildren(...table(groups, QUANTITIES[quantity]));
  }

  #sentence(found: QuantityStatistics | undefined, groups: readonly WellGroup[]): string {
    if (this.#refused !== "") return `The statistics could not be read: ${this.#refused}.`;
    if (this.#statistics === null) return "The statistics are being read.";
    const left = leftOutWords(found);
    if (groups.length === 0) return left === "" ? "No larva has this number yet." : left;
    const flagged = groups.some(({ values }) => values.some((v) => v.flagged)) ? "; a square has a flag" : "";
    const behind = referenceWords(groups);
    return (
      `A dot is a larva${flagged}. The line is the mean with its 95 % confidence interval.${left === "" ? "" : ` ${left}`}` +
      (behind === ""
        ? ""
        : ` The band behind holds 95 % of reference larvae of the same age, by the estimator of the references: ${behind}.`)
    );
  }

  /** Reads the statistics of the daemon when another well has a number. */
  async #read(): Promise<void> {
    const run = this.#run;
    if (run === null || !this.#panel.open) return;
    const of = measuredOf(run);
    if (of === this.#statisticsOf) return;
    let read: Statistics | null = null;
    let refused = "";
    try {
      read = await fetchStatistics(run.id);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      refused = error.message;
    }
    // Another run was opened meanwhile.
    if (this.#run === null || runKey(this.#run) !== runKey(run)) return;
    this.#statistics = read;
    this.#refused = refused;
    this.#statisticsOf = of;
    this.#draw();
  }
}

const MARGIN = { left: 58, right: 12, top: 12, bottom: 34 };
const HEIGHT = 300;
/** Distance of neighbouring dots across, px: dots of like values do not cover each other. */
const APART_PX = 7;

const ends = (interval: Interval | null | undefined): number[] => (interval ? [interval.low, interval.high] : []);

function picture(
  groups: readonly WellGroup[],
  { name, unit, size }: Shown,
  width: number,
  choose: (well: string) => void,
): SVGElement {
  const all = groups
    .flatMap((g) => [...g.values.map((v) => v.value), ...ends(g.mean_interval_95), ...ends(g.reference?.interval_95)])
    .map((value) => value / size);
  const levels = linearTicks(Math.min(...all), Math.max(...all));
  const [low, high] = [levels[0]!, levels.at(-1)!];
  const digits = levelDigits(levels);
  const bottom = HEIGHT - MARGIN.bottom;
  const y = (value: number) => bottom - ((value / size - low) / (high - low)) * (bottom - MARGIN.top);
  const slot = (width - MARGIN.left - MARGIN.right) / groups.length;
  const larvae = groups.reduce((sum, g) => sum + g.n, 0);
  const label = `${name} of ${counted(larvae, "larva", "larvae")} in ${counted(groups.length, "group")}; the table below has the numbers`;
  const chart = svg("svg", {
    width,
    height: HEIGHT,
    viewBox: `0 0 ${width} ${HEIGHT}`,
    role: "img",
    "aria-label": label,
  });
  chart.dataset["groups"] = String(groups.length);
  for (const level of levels) {
    const at = y(level * size);
    chart.append(
      svg("line", { class: "grid", x1: MARGIN.left, x2: width - MARGIN.right, y1: at, y2: at }),
      svg("text", { class: "tick", x: MARGIN.left - 8, y: at + 4, "text-anchor": "end" }, grouped(level, digits)),
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
    const band = group.reference?.interval_95;
    if (band) {
      const [top, base] = [y(band.high), y(band.low)];
      const across = { x: x - 0.48 * slot, width: 0.96 * slot };
      chart.append(svg("rect", { class: "groups-reference", ...across, y: top, height: base - top }));
    }
    const mean = y(group.mean);
    chart.append(svg("line", { class: "groups-mean", x1: x - half, x2: x + half, y1: mean, y2: mean }));
    const interval = group.mean_interval_95;
    if (interval) {
      chart.append(svg("line", { class: "groups-mean", x1: x, x2: x, y1: y(interval.low), y2: y(interval.high) }));
    }
    // Over the lines, so that each can be seen and clicked.
    for (const placed of spread(group.values, y, half)) chart.append(dot(placed, x, y, { unit, size }, choose));
    chart.append(svg("text", { class: "tick", x, y: bottom + 20, "text-anchor": "middle" }, letter(i)));
  });
  chart.append(svg("line", { class: "axis", x1: MARGIN.left, x2: width - MARGIN.right, y1: bottom, y2: bottom }));
  return chart;
}

/** The mark of a well. One with a flag has another shape, too. */
function dot(
  { well, value, flagged, shift }: WellValue & { shift: number },
  x: number,
  y: (value: number) => number,
  { unit, size }: Pick<Shown, "unit" | "size">,
  choose: (well: string) => void,
): SVGElement {
  const [at, up] = [x + shift, y(value)];
  const made = flagged
    ? svg("rect", { class: "groups-dot groups-flagged", x: at - 3.5, y: up - 3.5, width: 7, height: 7 })
    : svg("circle", { class: "groups-dot", cx: at, cy: up, r: 3.5 });
  made.dataset["well"] = well;
  made.append(svg("title", {}, `${well}: ${significant(value / size)} ${unit}${flagged ? ", with a flag" : ""}`));
  made.addEventListener("click", () => choose(well));
  return made;
}

function letter(group: number): string {
  return group < 26 ? String.fromCharCode(97 + group) : String(group + 1);
}

/** Places dots beside each other where their values are alike. */
function spread(
  wells: readonly WellValue[],
  y: (value: number) => number,
  half: number,
): (WellValue & { shift: number })[] {
  const rows = new Map<number, number>();
  return [...wells]
    .sort((a, b) => a.value - b.value)
    .map((well) => {
      const row = Math.round(y(well.value) / APART_PX);
      const count = rows.get(row) ?? 0;
      rows.set(row, count + 1);
      const shift = Math.ceil(count / 2) * APART_PX * (count % 2 === 0 ? 1 : -1);
      return { ...well, shift: Math.max(-half, Math.min(half, shift)) };
    });
}

function table(groups: readonly WellGroup[], { name, unit, size }: Shown): HTMLElement[] {
  const heads = ["Mark", "Group", "n", `Mean, ${unit}`, "SD", "95 % interval of the mean", "Median", "MAD"];
  const head = element("tr", "", ...heads.map((words) => element("th", "", words)));
  const number = (value: number | null) => (value === null ? "–" : significant(value / size));
  const rows = groups.map((group, i) => {
    const { n, mean, sd, mean_interval_95: interval, median, mad } = group;
    const between = interval === null ? "–" : `${number(interval.low)} to ${number(interval.high)}`;
    const words = capitalised(planWords(group.condition));
    const cells = [letter(i), words, grouped(n), number(mean), number(sd), between, number(median), number(mad)];
    return element("tr", "", ...cells.map((text) => element("td", "", text)));
  });
  return [element("caption", "", `${name} by group`), element("thead", "", head), element("tbody", "", ...rows)];
}
