// The plate: a grid of wells by row letter and column number; arrow keys walk over the planned wells.

import type { Coloured } from "./colouring.ts";
import { element, setText } from "./dom.ts";
import type { PlannedWell, SpecimenStatus, WellStatus } from "./status.ts";
import {
  CONDITIONS,
  conditionsOf,
  formatFor,
  place,
  rowName,
  spoken,
  wellName,
  type Condition,
  type PlateFormat,
} from "./wells.ts";

const STEPS: Record<string, [number, number]> = {
  ArrowUp: [-1, 0],
  ArrowDown: [1, 0],
  ArrowLeft: [0, -1],
  ArrowRight: [0, 1],
};

/** Draws the grid of a plate into a table. `cell` gives what a well shows; a well without a cell is drawn as not used. */
export function drawPlate(table: HTMLElement, format: PlateFormat, cell: (name: string) => HTMLElement | null): void {
  const head = element("tr", "", element("td", ""));
  for (let column = 0; column < format.columns; column += 1) {
    const heading = element("th", "", String(column + 1));
    heading.scope = "col";
    head.append(heading);
  }
  const rows = [head];
  for (let row = 0; row < format.rows; row += 1) {
    const heading = element("th", "", rowName(row));
    heading.scope = "row";
    const line = element("tr", "", heading);
    for (let column = 0; column < format.columns; column += 1) {
      line.append(element("td", "", cell(wellName(row, column)) ?? element("span", "well well-none")));
    }
    rows.push(line);
  }
  const wells = format.rows * format.columns;
  table.dataset["wells"] = String(wells);
  table.style.setProperty("--rows", String(format.rows));
  table.style.setProperty("--columns", String(format.columns));
  // A plate of 384 or 1536 wells needs the whole width of the page.
  table.closest(".columns")?.classList.toggle("columns-of-wide-plate", wells >= 384);
  table.replaceChildren(element("tbody", "", ...rows));
}

export class PlateView {
  readonly #table: HTMLElement;
  readonly #legend: HTMLElement;
  readonly #choose: (well: string) => void;
  readonly #buttons = new Map<string, HTMLButtonElement>();
  /** What each button shows. Only what changed is written: a plate may have 1536 wells. */
  readonly #written = new Map<string, string>();
  #layout = "";

  constructor(table: HTMLElement, legend: HTMLElement, choose: (well: string) => void) {
    this.#table = table;
    this.#legend = legend;
    this.#choose = choose;
    table.addEventListener("keydown", (event) => this.#walk(event));
  }

  update(
    wells: readonly WellStatus[],
    specimen: SpecimenStatus | null,
    chosen: string | null,
    coloured: ReadonlyMap<string, Coloured>,
    /** Number of wells of the plate, where the plan names it. */
    named: number | null,
    /** The wells in the plan, by name. */
    planned: ReadonlyMap<string, PlannedWell>,
  ): void {
    const names = wells.map((w) => w.well);
    const layout = `${named} ${names.join(" ")}`;
    if (layout !== this.#layout || this.#table.childElementCount === 0) {
      this.#layout = layout;
      this.#written.clear();
      this.#buttons.clear();
      const used = new Set(names);
      drawPlate(this.#table, formatFor(names, named), (name) => (used.has(name) ? this.#button(name) : null));
    }
    const conditions = conditionsOf(wells, specimen);
    const present = new Set<Condition>(conditions);
    for (const [i, well] of wells.entries()) {
      const button = this.#buttons.get(well.well);
      if (!button) continue;
      const condition = conditions[i]!;
      const tabbed = well.well === (chosen ?? names[0]);
      const title = spoken(well, condition, planned.get(well.well));
      const now = JSON.stringify([title, condition, coloured.get(well.well), well.well === chosen, tabbed]);
      if (this.#written.get(well.well) === now) continue;
      this.#written.set(well.well, now);
      button.className = `well well-${condition}`;
      button.classList.toggle("well-beyond", coloured.get(well.well)?.isBeyond === true);
      button.dataset["condition"] = condition;
      setText(button, CONDITIONS[condition].sign);
      const colour = coloured.get(well.well);
      button.style.background = colour?.background ?? "";
      button.style.color = colour?.ink ?? "";
      button.style.borderColor = colour ? "var(--edge)" : "";
      button.title = title + (colour ? `, ${colour.words}` : "");
      button.setAttribute("aria-label", button.title);
      button.setAttribute("aria-pressed", String(well.well === chosen));
      button.tabIndex = tabbed ? 0 : -1;
    }
    this.#explain(present);
  }

  #button(name: string): HTMLButtonElement {
    const button = element("button", "well");
    button.type = "button";
    button.dataset["well"] = name;
    button.addEventListener("click", () => this.#choose(name));
    this.#buttons.set(name, button);
    return button;
  }

  /** The nearest planned well in the direction of the arrow. Wells straight ahead come before others. */
  #walk(event: KeyboardEvent): void {
    const step = STEPS[event.key];
    const from = (event.target as HTMLElement).dataset["well"];
    const at = from === undefined ? null : place(from);
    if (!step || !at) return;
    let best: { name: string; cost: number } | null = null;
    for (const name of this.#buttons.keys()) {
      const to = place(name);
      if (!to || name === from) continue;
      const ahead = (to.row - at.row) * step[0] + (to.column - at.column) * step[1];
      const aside = Math.abs((to.row - at.row) * step[1]) + Math.abs((to.column - at.column) * step[0]);
      const cost = ahead + 8 * aside;
      if (ahead > 0 && (best === null || cost < best.cost)) best = { name, cost };
    }
    if (!best) return;
    event.preventDefault();
    this.#choose(best.name);
    this.#buttons.get(best.name)?.focus();
  }

  #explain(present: ReadonlySet<Condition>): void {
    const shown = (Object.keys(CONDITIONS) as Condition[]).filter((condition) => present.has(condition));
    if (this.#legend.dataset["shown"] === shown.join()) return;
    this.#legend.dataset["shown"] = shown.join();
    this.#legend.replaceChildren(
      ...shown.map((condition) => {
        const sample = element("span", `well well-${condition}`, CONDITIONS[condition].sign);
        sample.setAttribute("aria-hidden", "true");
        return element("li", "", sample, CONDITIONS[condition].label);
      }),
    );
  }
}
