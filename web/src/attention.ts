// Wells that need attention: those that did not go as planned, grouped by their reasons. A well with several flags is in the group of each.
// Wells that an abort left out are expected, and are not listed.

import { element } from "./dom.ts";
import { capitalised } from "./format.ts";
import { flagWords, reasonWords } from "./reasons.ts";
import type { WellStatus } from "./status.ts";
import { CONDITIONS, conditionOf, type Condition } from "./wells.ts";

export interface Group {
  condition: Condition;
  words: string;
  wells: string[];
}

/** Groups with failures first; within a condition the largest group first. Pure. */
export function toLookAt(wells: readonly WellStatus[]): Group[] {
  const order: readonly Condition[] = ["failed", "interrupted", "flagged", "skipped"];
  const groups = new Map<string, Group>();
  for (const well of wells) {
    const condition = conditionOf(well, null);
    if (!order.includes(condition)) continue;
    const reasons = condition === "flagged" ? well.flags.map(flagWords) : [reasonWords(well.reason ?? "")];
    for (const reason of reasons) {
      const words = reason === "" ? CONDITIONS[condition].label : reason;
      const key = `${condition} ${words}`;
      const group = groups.get(key) ?? { condition, words, wells: [] };
      group.wells.push(well.well);
      groups.set(key, group);
    }
  }
  const rank = (group: Group) => order.indexOf(group.condition);
  return [...groups.values()].sort((a, b) => rank(a) - rank(b) || b.wells.length - a.wells.length);
}

export class AttentionList {
  readonly #section: HTMLElement;
  readonly #list: HTMLElement;
  readonly #choose: (well: string) => void;
  #shown = "";

  constructor(section: HTMLElement, list: HTMLElement, choose: (well: string) => void) {
    this.#section = section;
    this.#list = list;
    this.#choose = choose;
  }

  update(wells: readonly WellStatus[]): void {
    const groups = toLookAt(wells);
    const now = JSON.stringify(groups);
    if (now === this.#shown) return;
    this.#shown = now;
    this.#section.hidden = groups.length === 0;
    this.#list.replaceChildren(...groups.map((group) => this.#item(group)));
  }

  #item({ condition, words, wells }: Group): HTMLElement {
    const { sign, label } = CONDITIONS[condition];
    const mark = element("span", `well well-${condition}`, sign);
    mark.title = label;
    mark.setAttribute("role", "img");
    mark.setAttribute("aria-label", label);
    const buttons = wells.map((well) => {
      const button = element("button", "well-link", well);
      button.type = "button";
      button.addEventListener("click", () => this.#choose(well));
      return button;
    });
    return element("li", "", mark, element("div", "", `${capitalised(words)} – `, ...buttons.flatMap((b) => [b, " "])));
  }
}
