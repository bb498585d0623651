// The wells of a run as a table on the page, sorted by a column that the reader chooses.

import { element } from "./dom.ts";
import { capitalised, grouped, significant } from "./format.ts";
import { flagWords } from "./reasons.ts";
import type { PlannedWell, WellStatus } from "./status.ts";
import { treatmentWords } from "./treatment.ts";
import { noteWords } from "./wellcard.ts";
import { conditionOf, conditionWords, contents, isBound } from "./wells.ts";

/** The wells in the plan of their run, by name. */
export type Planned = ReadonlyMap<string, PlannedWell>;

interface Column {
  name: string;
  /** What it is sorted by. Wells without a value come last. */
  value: (well: WellStatus, planned: Planned) => number | string | null;
  words: (well: WellStatus, planned: Planned) => string;
  /** Whether these are sentences, which need room. */
  isLong?: boolean;
}

/** How a well was treated; empty where the plan names nothing or is not read yet. */
function treatmentOf(well: WellStatus, planned: Planned): string {
  const found = planned.get(well.well);
  return found === undefined ? "" : treatmentWords(found);
}

const outcome = (well: WellStatus) => conditionWords(well, conditionOf(well, null));

const or = (value: number | null | undefined, words: (value: number) => string) =>
  value === null || value === undefined ? "–" : words(value);

const COLUMNS: readonly Column[] = [
  { name: "Well", value: (w) => w.well, words: (w) => w.well },
  { name: "Specimen", value: contents, words: (w) => capitalised(contents(w)) },
  { name: "Treatment", value: (w, planned) => treatmentOf(w, planned) || null, words: treatmentOf },
  { name: "Outcome", value: outcome, words: (w) => capitalised(outcome(w)) },
  measured("Volume, nL", (w) => w.volume_um3),
  spread("SD, nL", (w) => w.volume_sd_um3),
  measured("Area, mm²", (w) => w.area_um2),
  spread("SD, mm²", (w) => w.area_sd_um2),
  distance("Volume, SD from references", (w) => w.reference?.volume.z),
  distance("Area, SD from references", (w) => w.reference?.area.z),
  {
    name: "Flags",
    value: (w) => (w.flags.length === 0 ? null : w.flags.length),
    words: (w) => w.flags.map(flagWords).join("; "),
    isLong: true,
  },
  {
    name: "Remark",
    value: (w) => (w.note === null ? null : noteWords(w.note)),
    words: (w) => (w.note === null ? "" : noteWords(w.note)),
    isLong: true,
  },
];

/** A volume in nL of a number in um^3, or an area in mm^2 of one in um^2. */
function measured(name: string, of: (well: WellStatus) => number | null): Column {
  const words = (w: WellStatus) => or(of(w), (v) => `${isBound(w) ? "≥ " : ""}${significant(v / 1e6, 4)}`);
  return { name, value: of, words };
}

/** The standard deviation of such a number. A bound has none. */
function spread(name: string, of: (well: WellStatus) => number | null): Column {
  const value = (w: WellStatus) => (isBound(w) ? null : of(w));
  return { name, value, words: (w) => or(value(w), (v) => significant(v / 1e6, 2)) };
}

/** The distance of such a number from references. A bound has none. */
function distance(name: string, of: (well: WellStatus) => number | null | undefined): Column {
  const value = (w: WellStatus) => (isBound(w) ? null : (of(w) ?? null));
  return { name, value, words: (w) => or(value(w), (v) => grouped(v, 1)) };
}

/** The wells by a column. Those without a value come last in both directions. Pure. */
export function sorted(
  wells: readonly WellStatus[],
  column: number,
  descending: boolean,
  planned: Planned = new Map(),
): WellStatus[] {
  const { value } = COLUMNS[column]!;
  const sign = descending ? -1 : 1;
  return [...wells].sort((a, b) => {
    const [x, y] = [value(a, planned), value(b, planned)];
    if (x === null || y === null) return Number(x === null) - Number(y === null);
    if (typeof x === "number" && typeof y === "number") return sign * (x - y);
    return sign * String(x).localeCompare(String(y), "en", { numeric: true });
  });
}

export class ResultsTable {
  readonly #panel: HTMLElement;
  readonly #table: HTMLElement;
  readonly #choose: (well: string) => void;
  #column = 0;
  #descending = false;
  #wells: readonly WellStatus[] = [];
  #planned: Planned = new Map();
  #chosen: string | null = null;
  #shown = "";

  constructor(panel: HTMLElement, table: HTMLElement, choose: (well: string) => void) {
    this.#panel = panel;
    this.#table = table;
    this.#choose = choose;
  }

  update(wells: readonly WellStatus[], chosen: string | null, planned: Planned): void {
    this.#panel.hidden = wells.length === 0;
    this.#wells = wells;
    this.#planned = planned;
    this.#chosen = chosen;
    this.#draw();
  }

  #draw(): void {
    const now = JSON.stringify([
      this.#wells,
      [...this.#planned.values()],
      this.#chosen,
      this.#column,
      this.#descending,
    ]);
    if (now === this.#shown) return;
    this.#shown = now;
    const hadFocus = this.#table.contains(document.activeElement)
      ? (document.activeElement as HTMLElement).dataset["key"]
      : undefined;
    const head = element("tr", "", ...COLUMNS.map((column, i) => this.#heading(column, i)));
    const rows = sorted(this.#wells, this.#column, this.#descending, this.#planned).map((well) => this.#row(well));
    this.#table.replaceChildren(element("thead", "", head), element("tbody", "", ...rows));
    if (hadFocus !== undefined) this.#table.querySelector<HTMLElement>(`[data-key="${hadFocus}"]`)?.focus();
  }

  #heading({ name }: Column, i: number): HTMLElement {
    const button = element("button", "sort", name);
    button.type = "button";
    button.dataset["key"] = `column-${i}`;
    button.addEventListener("click", () => {
      this.#descending = i === this.#column && !this.#descending;
      this.#column = i;
      this.#draw();
    });
    const cell = element("th", "", button);
    cell.scope = "col";
    if (i === this.#column) cell.setAttribute("aria-sort", this.#descending ? "descending" : "ascending");
    return cell;
  }

  #row(well: WellStatus): HTMLElement {
    const open = element("button", "well-link", well.well);
    open.type = "button";
    open.dataset["key"] = well.well;
    open.addEventListener("click", () => this.#choose(well.well));
    const row = element(
      "tr",
      "",
      element("td", "", open),
      ...COLUMNS.slice(1).map((c) => element("td", c.isLong ? "long" : "", c.words(well, this.#planned))),
    );
    if (well.well === this.#chosen) row.setAttribute("aria-current", "true");
    return row;
  }
}
