// By what the plate is coloured: the choice, the legend of the scale, and the colour of each well.

import { element, setText, show } from "./dom.ts";
import {
  colourAt,
  colourOf,
  COLOURINGS,
  controlsOf,
  LEAST_CONTROLS,
  rangeOf,
  valueOf,
  valueWords,
  type Colour,
  type Colouring,
} from "./scale.ts";
import type { PlannedWell, WellStatus } from "./status.ts";

/** The colour of a well, and its number in words. */
export interface Coloured extends Colour {
  words: string;
}

const KEY = "carved.colouring";
/** The parts of the legend's bar. */
const PARTS = 24;

export class PlateColouring {
  readonly #choice: HTMLSelectElement;
  readonly #legend: HTMLElement;
  #shown = "";

  constructor(choice: HTMLSelectElement, legend: HTMLElement, changed: () => void) {
    this.#choice = choice;
    this.#legend = legend;
    const kept = localStorage.getItem(KEY);
    choice.replaceChildren(
      ...Object.entries(COLOURINGS).map(([value, words]) => {
        const option = element("option", "", words);
        option.value = value;
        option.selected = value === kept;
        return option;
      }),
    );
    choice.addEventListener("change", () => {
      localStorage.setItem(KEY, choice.value);
      changed();
    });
  }

  /** The wells that have a colour by their number. `plan` gives the plate map, or nothing until it is read. */
  of(wells: readonly WellStatus[], plan: () => readonly PlannedWell[]): ReadonlyMap<string, Coloured> {
    const by = this.#choice.value as Colouring;
    const controls = by === "controls" ? controlsOf(wells, plan()) : null;
    const values = new Map<string, number>();
    for (const well of wells) {
      const value = valueOf(well, by, controls);
      if (value !== null) values.set(well.well, value);
    }
    const range = rangeOf([...values.values()], by);
    this.#explain(by, range === null ? null : [valueWords(range.least, by), valueWords(range.most, by)]);
    if (range === null) return new Map();
    return new Map(
      [...values].map(([well, value]) => [well, { ...colourOf(value, range, by), words: valueWords(value, by) }]),
    );
  }

  #explain(by: Colouring, ends: [string, string] | null): void {
    show(this.#legend, by !== "outcome");
    const now = JSON.stringify([by, ends]);
    if (by === "outcome" || now === this.#shown) return;
    this.#shown = now;
    if (ends === null) {
      setText(
        this.#legend,
        by === "controls"
          ? `No colours: fewer than ${LEAST_CONTROLS} negative controls of this plate are measured, or they are all alike.`
          : "No colours yet: no well has this number.",
      );
      return;
    }
    const bar = element("span", "scale");
    bar.append(
      ...Array.from({ length: PARTS }, (_, i) => {
        const part = element("span", "");
        part.style.background = colourAt(i / (PARTS - 1), by).background;
        return part;
      }),
    );
    this.#legend.replaceChildren(
      element("span", "", ends[0]),
      bar,
      element("span", "", ends[1]),
      element("span", "scale-none", "Wells without this number have no colour."),
    );
  }
}
