// The list of faults: what to do, what happened, and since when. The headline of the page has the remedy and the button of one of them.

import { post, Refused } from "./api.ts";
import { element, setText, show } from "./dom.ts";
import { clockTime, words } from "./format.ts";
import { byPerson } from "./person.ts";
import type { NextStep } from "./plain.ts";
import type { Fault } from "./status.ts";

export class FaultsView {
  readonly #section: HTMLElement;
  readonly #list: HTMLElement;
  #shown = "";

  constructor(section: HTMLElement, list: HTMLElement) {
    this.#section = section;
    this.#list = list;
  }

  /** `next`: the headline of the page, which may have the remedy of one of them, and its button. */
  update(faults: readonly Fault[], next: NextStep | null): void {
    const now = JSON.stringify([faults, next]);
    if (now === this.#shown) return;
    this.#shown = now;
    show(this.#section, faults.length > 0);
    this.#list.replaceChildren(...faults.map((fault) => item(fault, fault.seq === next?.fault ? next : null)));
  }
}

/** `headline`: the next step, if it is about this fault. */
function item(fault: Fault, headline: NextStep | null): HTMLElement {
  const meaning = fault.meaning || fault.message;
  const head = element("p", "fault-head", element("strong", "", headline ? meaning : fault.what_to_do));
  if (fault.operator_required) head.append(element("span", "tag tag-alarm", "Needs you"));
  // The details are for the person who repairs the instrument.
  const small = `Fault ${fault.seq}, ${words(fault.code)}, since ${clockTime(fault.since)}.`;
  const made = element("li", "fault", head);
  if (!headline) made.append(element("p", "", meaning));
  made.append(element("p", "fault-code", small));
  if (fault.meaning && fault.meaning !== fault.message) {
    const found = element("p", "", `Found: ${fault.message}`);
    made.append(element("details", "fault-code", element("summary", "", "Details for support"), found));
  }
  if (headline?.button !== "acknowledge" && !fault.ends_by_itself) made.append(actions(fault));
  made.dataset["code"] = fault.code;
  return made;
}

function actions(fault: Fault): HTMLElement {
  const answer = element("span", "fault-answer");
  answer.role = "status";
  const button = element("button", "button button-small", `Acknowledge fault ${fault.seq}`);
  button.type = "button";
  button.addEventListener("click", () => void acknowledge(fault, button, answer));
  return element("p", "fault-actions", button, answer);
}

/** Acknowledges a fault. The next status no longer lists it. */
async function acknowledge(fault: Fault, button: HTMLButtonElement, answer: HTMLElement): Promise<void> {
  button.disabled = true;
  try {
    await post(`/v1/faults/${fault.seq}/acknowledge${byPerson()}`);
  } catch (error) {
    button.disabled = false;
    setText(answer, `Not acknowledged: ${error instanceof Refused ? error.message : String(error)}`);
  }
}
