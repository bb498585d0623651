// The list of faults: what happened, since when, and what to do.

import { post, Refused } from "./api.ts";
import { element, setText, show } from "./dom.ts";
import { clockTime, words } from "./format.ts";
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
  const answer = element("span", "fault-answer");
  answer.role = "status";
  const button = element("button", "button button-small", "Acknowledge");
  button.type = "button";
  button.addEventListener("click", () => void acknowledge(fault, button, answer));
  const head = element("p", "fault-head", element("strong", "", fault.meaning || fault.message));
  if (fault.operator_required) head.append(element("span", "tag tag-alarm", "Needs you"));
  // The operator reads the meaning of the code. The details are for the person who repairs the instrument.
  const found = fault.meaning && fault.meaning !== fault.message ? ` Found: ${fault.message}` : "";
  const small = `Fault ${fault.seq}, ${words(fault.code)}, since ${clockTime(fault.since)}.${found}`;
  const made = element(
    "li",
    "fault",
    head,
    element("p", "fault-advice", element("b", "", "What to do: "), fault.what_to_do),
    element("p", "fault-code", small),
    element("p", "fault-actions", button, answer),
  );
  made.dataset["code"] = fault.code;
  return made;
}

/** Acknowledges a fault. The next status no longer lists it. */
async function acknowledge(fault: Fault, button: HTMLButtonElement, answer: HTMLElement): Promise<void> {
  button.disabled = true;
  try {
    await post(`/v1/faults/${fault.seq}/acknowledge`);
    // Most faults disappear with the next status.
    setText(answer, "Acknowledged. It stays listed until its cause is gone.");
  } catch (error) {
    button.disabled = false;
    setText(answer, `Not acknowledged: ${error instanceof Refused ? error.message : String(error)}`);
  }
}
