// The instrument's token, if it requires one (outside loopback). It is typed once and kept until the tab is closed.

import { show } from "./dom.ts";
import { remember, remembered } from "./remembered.ts";

const KEY = "carved-token";

export function authorization(): HeadersInit {
  const token = remembered(KEY, "the tab");
  return token === null ? {} : { Authorization: `Bearer ${token}` };
}

export class TokenForm {
  readonly #form: HTMLFormElement;
  readonly #input: HTMLInputElement;

  constructor(form: HTMLFormElement, input: HTMLInputElement) {
    this.#form = form;
    this.#input = input;
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      remember(KEY, input.value.trim(), "the tab");
      input.value = "";
    });
  }

  wanted(yes: boolean): void {
    if (yes && this.#form.hidden) {
      show(this.#form, true);
      this.#input.focus();
    } else if (!yes) {
      show(this.#form, false);
    }
  }
}
