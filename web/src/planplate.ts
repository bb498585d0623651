// A plate map before the start: each well with what is in it and how it was treated. Wells that are treated alike have one colour and one
// letter, so that colour is not the only indication.

import { element, show } from "./dom.ts";
import { counted } from "./format.ts";
import { drawPlate } from "./plate.ts";
import type { PlannedWell } from "./status.ts";
import { planWords } from "./treatment.ts";
import { formatFor } from "./wells.ts";

/** Wells that are planned alike. */
export interface PlanGroup {
  words: string;
  wells: PlannedWell[];
}

/** Colours of Okabe and Ito, which readers with any colour vision distinguish, each with an ink of sufficient contrast. */
const PALETTE = [
  ["#56b4e9", "#000"],
  ["#e69f00", "#000"],
  ["#009e73", "#000"],
  ["#f0e442", "#000"],
  ["#cc79a7", "#000"],
  ["#d55e00", "#000"],
  ["#0072b2", "#fff"],
  ["#bbbbbb", "#000"],
] as const;

/** Angle between the hues of two further groups, deg: no small number of steps comes back to the same hue. */
const HUE_STEP_DEG = 137.508;

/** Background and ink of a group by its number from 0. Each group has a colour of its own. Pure. */
export function coloursOf(group: number): readonly [string, string] {
  const known = PALETTE[group];
  if (known !== undefined) return known;
  const hue = Math.round((group * HUE_STEP_DEG) % 360);
  // Light and dark in turn, with the ink that is legible on any hue of this lightness.
  return group % 2 === 0 ? [`hsl(${hue} 60% 78%)`, "#000"] : [`hsl(${hue} 60% 26%)`, "#fff"];
}

/** The groups in the order of their first wells. Pure. */
export function groupsOf(wells: readonly PlannedWell[]): PlanGroup[] {
  const groups = new Map<string, PlanGroup>();
  for (const well of wells) {
    const words = planWords(well);
    const group = groups.get(words) ?? { words, wells: [] };
    group.wells.push(well);
    groups.set(words, group);
  }
  return [...groups.values()];
}

function painted<T extends HTMLElement>(made: T, group: number): T {
  const [background, ink] = coloursOf(group);
  made.style.background = background;
  made.style.color = ink;
  const mark = element("span", "mark", markOf(group));
  mark.style.setProperty("--letters", String(mark.textContent.length));
  made.append(mark);
  return made;
}

/** The mark of a group by its number from 0: a to z, aa to zz, aaa and so on. Pure. */
export function markOf(group: number): string {
  const letter = String.fromCharCode(97 + (group % 26));
  return group < 26 ? letter : markOf(Math.floor(group / 26) - 1) + letter;
}

export class PlanPlate {
  readonly #box: HTMLElement;
  readonly #table: HTMLElement;
  readonly #legend: HTMLElement;

  constructor(root: { box: HTMLElement; table: HTMLElement; legend: HTMLElement }) {
    this.#box = root.box;
    this.#table = root.table;
    this.#legend = root.legend;
  }

  /** Draws a plate map, on a plate of so many wells if that is known. Without wells nothing is shown. */
  update(wells: readonly PlannedWell[], named: number | null): void {
    show(this.#box, wells.length > 0);
    if (wells.length === 0) return;
    const groups = groupsOf(wells);
    const number = new Map(groups.flatMap((group, i) => group.wells.map(({ well }) => [well, i] as const)));
    const order = new Map(wells.map(({ well }, i) => [well, i + 1]));
    const format = formatFor([...order.keys()], named);
    drawPlate(this.#table, format, (name) => {
      const group = number.get(name);
      if (group === undefined) return null;
      const cell = painted(element("button", "well"), group);
      cell.type = "button";
      cell.dataset["planned"] = name;
      cell.title = `${name}: ${groups[group]!.words}; number ${order.get(name)} of the run; a click corrects it`;
      return cell;
    });
    const listed = groups.map((group, i) => {
      const sample = painted(element("span", "well"), i);
      sample.setAttribute("aria-hidden", "true");
      return element("li", "", sample, `${group.words} (${counted(group.wells.length, "well")})`);
    });
    this.#legend.replaceChildren(...listed);
  }
}
