// A plate map before the start: each well with what is in it and how it was treated. Wells that are treated alike have one colour and one
// letter, so that colour is not the only indication.

import { element, show } from "./dom.ts";
import { counted, significant } from "./format.ts";
import { drawPlate } from "./plate.ts";
import type { PlannedWell, WellCondition } from "./status.ts";
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
/** Groups that have a colour and a letter of their own. */
const NAMED = 26;

/** What is in a well and how it was treated, in a plate map or in a group of wells. */
type Treatment = Partial<WellCondition>;

/** What is in a well and how it was treated, in words: `larva, 3 dpf, DMSO 0.1 %, negative control`. Pure. */
export function planWords(well: Treatment): string {
  const dose =
    well.concentration == null
      ? ""
      : ` ${significant(well.concentration, 3)} ${well.concentration_unit ?? ""}`.trimEnd();
  return [
    well.specimen ?? "larva",
    well.dpf == null ? "" : `${well.dpf} dpf`,
    well.compound == null ? "" : `${well.compound}${dose}`,
    well.treatment ?? "",
    well.strain ?? "",
    well.control == null ? "" : `${well.control} control`,
  ]
    .filter((part) => part !== "")
    .join(", ");
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

function painted(made: HTMLElement, group: number): HTMLElement {
  const [background, ink] = PALETTE[group % PALETTE.length]!;
  made.style.background = background;
  made.style.color = ink;
  made.textContent = group < NAMED ? String.fromCharCode(97 + group) : "…";
  return made;
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
      const cell = painted(element("span", "well"), group);
      cell.dataset["planned"] = name;
      cell.title = `${name}: ${groups[group]!.words}; number ${order.get(name)} of the run`;
      return cell;
    });
    const listed = groups.slice(0, NAMED).map((group, i) => {
      const sample = painted(element("span", "well"), i);
      sample.setAttribute("aria-hidden", "true");
      return element("li", "", sample, `${group.words} (${counted(group.wells.length, "well")})`);
    });
    const more = groups.slice(NAMED).flatMap((group) => group.wells).length;
    if (more > 0) listed.push(element("li", "", `${counted(more, "well")} of ${groups.length - NAMED} other kinds`));
    this.#legend.replaceChildren(...listed);
  }
}
