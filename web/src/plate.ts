// The plate: a grid of wells by row letter and column number; arrow keys walk over the planned wells.

import type { Coloured } from "./colouring.ts";
import { element, setText } from "./dom.ts";
import type { SpecimenStatus, WellStatus } from "./status.ts";
import {
  CONDITIONS,
  conditionOf,
  formatFor,
  place,
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

export class PlateView {
  readonly #table: HTMLElement;
  readonly #legend: HTMLElement;
  readonly #choose: (well: string) => void;
  readonly #buttons = new Map<string, HTMLButtonElement>();
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
  ): void {
    const names = wells.map((w) => w.well);
    const layout = names.join(" ");
    if (layout !== this.#layout || this.#table.childElementCount === 0) {
      this.#layout = layout;
      this.#build(formatFor(names), new Set(names));
    }
    const present = new Set<Condition>();
    for (const well of wells) {
      const button = this.#buttons.get(well.well);
      if (!button) continue;
      const condition = conditionOf(well, specimen, wells);
      present.add(condition);
      button.className = `well well-${condition}`;
      button.dataset["condition"] = condition;
      setText(button, CONDITIONS[condition].sign);
      const colour = coloured.get(well.well);
      button.style.background = colour?.background ?? "";
      button.style.color = colour?.ink ?? "";
      button.style.borderColor = colour ? "var(--edge)" : "";
      button.title = spoken(well, condition) + (colour ? `, ${colour.words}` : "");
      button.setAttribute("aria-label", button.title);
      button.setAttribute("aria-pressed", String(well.well === chosen));
      button.tabIndex = well.well === (chosen ?? names[0]) ? 0 : -1;
    }
    this.#explain(present);
  }

  #build(format: PlateFormat, planned: ReadonlySet<string>): void {
    this.#buttons.clear();
    const head = element("tr", "", element("td", ""));
    for (let column = 0; column < format.columns; column += 1) {
      const cell = element("th", "", String(column + 1));
      cell.scope = "col";
      head.append(cell);
    }
    const rows = [head];
    for (let row = 0; row < format.rows; row += 1) {
      const header = element("th", "", wellName(row, 0).charAt(0));
      header.scope = "row";
      const line = element("tr", "", header);
      for (let column = 0; column < format.columns; column += 1) {
        const name = wellName(row, column);
        line.append(element("td", "", planned.has(name) ? this.#button(name) : element("span", "well well-none")));
      }
      rows.push(line);
    }
    this.#table.classList.toggle("plate-384", format.columns > 12);
    this.#table.replaceChildren(element("tbody", "", ...rows));
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
