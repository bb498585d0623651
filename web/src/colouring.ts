// By what the plate is coloured: the choice, the legend of the scale, and the colour of each well.

import { element, setText, show } from "./dom.ts";
import {
  colourAt,
  colourOf,
  COLOURINGS,
  controlsOf,
  isBeyond,
  rangeOf,
  scaledWells,
  valueOf,
  valueWords,
  whyNone,
  type Colour,
  type Colouring,
} from "./scale.ts";
import { remember, remembered } from "./remembered.ts";
import type { PlannedWell, WellStatus } from "./status.ts";

/** The colour of a well, and its number in words. */
export interface Coloured extends Colour {
  words: string;
  /** Whether the number lies beyond the ends of the scale. */
  isBeyond: boolean;
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
    const kept = remembered(KEY);
    choice.replaceChildren(
      ...Object.entries(COLOURINGS).map(([value, words]) => {
        const option = element("option", "", words);
        option.value = value;
        option.selected = value === kept;
        return option;
      }),
    );
    choice.addEventListener("change", () => {
      remember(KEY, choice.value);
      changed();
    });
  }

  /** The wells that have a colour by their number. `plan`: the plate map, empty until it is read. */
  of(wells: readonly WellStatus[], plan: readonly PlannedWell[]): ReadonlyMap<string, Coloured> {
    const by = this.#choice.value as Colouring;
    const controls = by === "controls" ? controlsOf(wells, plan) : null;
    const values = new Map<string, number>();
    const scaled = scaledWells(wells, by);
    for (const well of scaled) {
      const value = valueOf(well, by, controls);
      if (value !== null) values.set(well.well, value);
    }
    const range = rangeOf([...values.values()], by);
    if (range === null) this.#explain(by, whyNone(wells, by, plan), null);
    else {
      const without = scaled.length < wells.length ? "Beads and wells" : "Wells";
      const ends: [string, string] = [valueWords(range.least, by), valueWords(range.most, by)];
      const beyond = [...values.values()].some((value) => isBeyond(value, range));
      const marked = beyond ? " A double edge marks a number beyond the scale." : "";
      const left = controls?.leftOut ?? [];
      const of = left.length + (controls?.n ?? 0);
      const are = left.length === 1 ? "is" : "are";
      const out = left.length === 0 ? "" : ` ${left.length} of ${of} controls ${are} left out: ${left.join(", ")}.`;
      this.#explain(by, `${without} without this number have no colour.${out}${marked}`, ends);
    }
    if (range === null) return new Map();
    const coloured = (value: number): Coloured => {
      const beyond = isBeyond(value, range);
      const words = `${valueWords(value, by)}${beyond ? ", beyond the scale" : ""}`;
      return { ...colourOf(value, range, by), words, isBeyond: beyond };
    };
    return new Map([...values].map(([well, value]) => [well, coloured(value)]));
  }

  /** `ends`: the words at the ends of the scale; null if no well has a colour. */
  #explain(by: Colouring, words: string, ends: [string, string] | null): void {
    show(this.#legend, by !== "outcome");
    const now = JSON.stringify([by, words, ends]);
    if (by === "outcome" || now === this.#shown) return;
    this.#shown = now;
    if (ends === null) {
      setText(this.#legend, words);
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
      element("span", "scale-none", words),
    );
  }
}
