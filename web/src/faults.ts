// The list of faults: what happened, since when, what to do.

import { element, show } from "./dom.ts";
import { clockTime, words } from "./format.ts";
import { advice } from "./plain.ts";
import type { Fault } from "./status.ts";

export class FaultsView {
  readonly #section: HTMLElement;
  readonly #list: HTMLElement;
  #shown = "";

  constructor(section: HTMLElement, list: HTMLElement) {
    this.#section = section;
    this.#list = list;
  }

  update(faults: readonly Fault[]): void {
    const now = JSON.stringify(faults);
    if (now === this.#shown) return;
    this.#shown = now;
    show(this.#section, faults.length > 0);
    this.#list.replaceChildren(...faults.map(item));
  }
}

function item(fault: Fault): HTMLElement {
  const head = element("p", "fault-head", element("strong", "", fault.message));
  if (fault.operator_required) head.append(element("span", "tag tag-alarm", "Needs you"));
  const small = `Fault ${fault.seq}, ${words(fault.code)} (${words(fault.category)}), since ${clockTime(fault.since)}`;
  const made = element(
    "li",
    "fault",
    head,
    element("p", "fault-advice", element("b", "", "What to do: "), advice(fault)),
    element("p", "fault-code", small),
  );
  made.dataset["code"] = fault.code;
  return made;
}
