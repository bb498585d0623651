// The plates that wait for their turn: added by the form for a new run, changed, ordered and removed here. A plate begins when somebody, the
// loader or a person, reports its barcode as that of the plate in its place.

import { beginNext, fetchQueued, orderQueue, queuePlate, Refused, unqueue } from "./api.ts";
import { bringIntoView, element, setText, show } from "./dom.ts";
import { counted } from "./format.ts";
import { canStart } from "./plain.ts";
import type { QueuedPlate, RunPlan, Status } from "./status.ts";

/** The form for a new run, which also makes and changes what is queued. */
export interface PlanForm {
  /** Opens it for a plate that is queued. */
  forQueue(): void;
  /** Opens it with a queued plan. */
  change(run: string, plan: RunPlan): void;
}

/** A plate that was removed, and its place. */
interface Removed {
  run: string;
  plan: RunPlan;
  place: number;
}

/** The runs in the order with one of them moved by some places. Pure. */
export function moved(runs: readonly string[], run: string, by: number): string[] {
  const rest = runs.filter((other) => other !== run);
  rest.splice(Math.max(0, runs.indexOf(run) + by), 0, run);
  return rest;
}

export class QueueView {
  readonly #panel: HTMLDetailsElement;
  readonly #heading: HTMLElement;
  readonly #list: HTMLElement;
  readonly #next: HTMLFormElement;
  readonly #barcode: HTMLInputElement;
  readonly #begin: HTMLButtonElement;
  readonly #words: HTMLElement;
  readonly #back: HTMLButtonElement;
  readonly #form: PlanForm;
  #queue: readonly QueuedPlate[] = [];
  #drawn = "";
  #removed: Removed | null = null;
  #startable = false;
  #busy = false;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T, form: PlanForm) {
    this.#panel = find("queue");
    this.#heading = find("queue-heading");
    this.#list = find("queue-list");
    this.#next = find("queue-next");
    this.#barcode = find("queue-barcode");
    this.#begin = find("queue-begin");
    this.#words = find("queue-words");
    this.#back = find("queue-back");
    this.#form = form;
    find("queue-add").addEventListener("click", () => form.forQueue());
    this.#back.addEventListener("click", () => void this.#putBack());
    this.#barcode.addEventListener("input", () => this.#enable());
    this.#next.addEventListener("submit", (event) => {
      event.preventDefault();
      void this.#beginNext();
    });
  }

  update(status: Status): void {
    this.#queue = status.queue;
    this.#startable = canStart(status);
    const now = JSON.stringify(this.#queue);
    if (now !== this.#drawn) {
      // What waits when the page is opened is shown without a click.
      if (this.#drawn === "" && this.#queue.length > 0) this.#panel.open = true;
      this.#drawn = now;
      this.#draw();
    }
    this.#enable();
  }

  #draw(): void {
    const [first] = this.#queue;
    setText(
      this.#heading,
      first === undefined
        ? "Queue of plates"
        : `Queue of plates: ${counted(this.#queue.length, "plate")}, next ${first.plate_barcode}`,
    );
    // The button that was used is made anew: the focus stays on its successor.
    const focused = document.activeElement instanceof HTMLElement ? document.activeElement.dataset["does"] : undefined;
    this.#list.replaceChildren(...this.#queue.map((plate, i) => this.#entry(plate, i)));
    if (focused !== undefined)
      this.#list.querySelector<HTMLElement>(`[data-does="${CSS.escape(focused)}"]:enabled`)?.focus();
    show(this.#next, first !== undefined);
  }

  #entry(plate: QueuedPlate, place: number): HTMLElement {
    const { run, plate_barcode: barcode, method, operator, wells, trouble } = plate;
    const does = (what: string, label: string, job: () => Promise<void>) => {
      const button = element("button", "button button-small", what);
      button.type = "button";
      button.setAttribute("aria-label", label);
      button.dataset["does"] = `${what} ${run}`;
      button.addEventListener("click", () => void this.#work(job));
      return button;
    };
    const order = (by: number) => orderQueue(moved(this.#runs(), run, by));
    const up = does("↑", `Move ${barcode} up`, () => order(-1));
    const down = does("↓", `Move ${barcode} down`, () => order(1));
    up.disabled = place === 0;
    down.disabled = place === this.#queue.length - 1;
    const buttons = element(
      "span",
      "queue-buttons",
      up,
      down,
      does("Change", `Change ${barcode}`, async () => this.#form.change(run, await fetchQueued(run))),
      does("Remove", `Remove ${barcode}`, () => this.#remove(run, barcode)),
    );
    const words = element(
      "span",
      "",
      element("b", "", barcode),
      ` · ${counted(wells, "well")} · ${method} · ${operator} · run ${run}`,
    );
    const item = element("li", "", words, buttons);
    item.dataset["run"] = run;
    if (trouble !== null) item.append(element("p", "queue-trouble", `It cannot begin as it is: ${trouble}.`));
    return item;
  }

  #runs(): string[] {
    return this.#queue.map((plate) => plate.run);
  }

  async #remove(run: string, barcode: string): Promise<void> {
    const place = this.#runs().indexOf(run);
    const plan = await fetchQueued(run);
    await unqueue(run);
    this.#removed = { run, plan, place };
    this.#say(`Plate ${barcode} is out of the queue.`);
  }

  async #putBack(): Promise<void> {
    const removed = this.#removed;
    if (removed === null) return;
    const before = this.#runs();
    await this.#work(async () => {
      await queuePlate(removed.run, removed.plan);
      before.splice(removed.place, 0, removed.run);
      this.#removed = null;
      this.#say(`Plate ${removed.plan.plate_barcode} is in the queue again.`);
      await orderQueue(before);
    });
  }

  async #beginNext(): Promise<void> {
    const barcode = this.#barcode.value.trim();
    await this.#work(async () => {
      const run = await beginNext(barcode);
      this.#barcode.value = "";
      this.#say(`Plate ${barcode} has begun as run ${run}.`);
    });
  }

  /** Does one thing at a time, and says why it was refused. */
  async #work(job: () => Promise<void>): Promise<void> {
    if (this.#busy) return;
    this.#busy = true;
    this.#say("");
    try {
      await job();
    } catch (error) {
      this.#say(`Nothing was changed: ${error instanceof Refused ? error.message : String(error)}.`);
    } finally {
      this.#busy = false;
      this.#enable();
    }
  }

  #enable(): void {
    this.#begin.disabled = this.#busy || !this.#startable || this.#barcode.value.trim() === "";
    show(this.#back, this.#removed !== null);
  }

  #say(words: string): void {
    setText(this.#words, words);
    show(this.#words, words !== "");
    if (words !== "") bringIntoView(this.#words);
  }
}
