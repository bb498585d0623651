// What happened in a run, in plain words: its events, the newest first. They are read when the list is opened, and followed while it is open.

import { fetchRunEvents, Refused } from "./api.ts";
import { element, setText, show } from "./dom.ts";
import { capitalised, counted, moment, duration, nanolitres, words } from "./format.ts";
import { Latest } from "./latest.ts";
import { OUTCOMES, PHASES } from "./plain.ts";
import { flagWords, isBoundBy, reasonWords } from "./reasons.ts";
import { runKey } from "./stored.ts";
import type { Phase, RunEvent, RunOutcome, RunStatus, SpecimenOutcome, WellNote } from "./status.ts";
import { noteWords } from "./wellcard.ts";

/** How much an event matters: steps of the work are hidden at first. */
export type Weight = "step" | "news" | "trouble";

export interface Entry {
  weight: Weight;
  words: string;
}

type Data = Record<string, unknown>;

const text = (value: unknown) => (typeof value === "string" ? value : "");
const sentence = (value: string) => capitalised(value.replace(/\.?$/, "."));

/** Sentences, each once. */
const said = (values: unknown[]) => [...new Set(values.map(text).filter(Boolean).map(sentence))].join(" ");

const FOUND: Record<string, string> = {
  larva: "a larva",
  bead: "a bead",
  empty: "nothing",
  two: "two larvae or more",
  bubble: "an air bubble",
  debris: "debris",
};

const DONE: Record<SpecimenOutcome, string> = {
  succeeded: "measured",
  failed: "failed",
  aborted: "not measured",
  interrupted: "interrupted and given up",
  skipped: "skipped",
};

const WORDS: Record<string, (data: Data, well: string) => Entry> = {
  "run.accepted": (d) =>
    news(`The run was accepted for plate ${text(d["plate_barcode"])}, method ${text(d["method"])}.`),
  "run.started": () => news("The instrument is ready; the wells follow."),
  "run.hold_requested": (d) => news(`${asked(d)} asked to hold the run.`),
  "run.stop_requested": (d) => news(`${asked(d)} asked to stop the run after the well.`),
  "run.abort_requested": (d) => trouble(`${asked(d)} asked to abort the run.`),
  "run.held": (d) => {
    const cause = d["by"] === "operator" ? "An operator holds the run." : sentence(`the run is held: ${heldBy(d)}`);
    return d["by"] === "operator" ? news(cause) : trouble(cause);
  },
  "run.resumed": (d) =>
    news(d["by"] === "instrument" ? "The run continues by itself." : `${asked(d, "name")} lets the run go on.`),
  "run.interrupted": () => trouble("The program was started again and found the run open."),
  "run.unreadable": (d) => trouble(sentence(`the record of the run could not be read: ${text(d["why"])}`)),
  "run.ended": (d) => news(`The run ${OUTCOMES[text(d["outcome"]) as RunOutcome] ?? "ended"}.`),
  "well.awaited": (_, well) => step(`The loader is asked for the specimen of ${well}.`),
  "well.loaded": (_, well) => step(`The specimen of ${well} is in the capillary.`),
  "well.taken_out": (_, well) => step(`The specimen of ${well} was taken out while the sampler was at work.`),
  "well.unloaded": (_, well) => step(`The specimen of ${well} was taken out.`),
  "well.skipped": (d, well) => news(sentence(`${text(d["by"])} skips ${well}: ${text(d["reason"])}`)),
  "well.redo_requested": (d, well) =>
    news(sentence(`${text(d["by"])} has ${well} measured again: ${text(d["reason"])}`)),
  "well.noted": (d, well) => news(`${well}: ${noteWords(d as unknown as WellNote)}`),
  "specimen.phase": (d, well) => step(`${well}: ${PHASES[text(d["phase"]) as Phase] ?? words(text(d["phase"]))}.`),
  "specimen.detected": (d, well) =>
    step(`${well}: the first frame shows ${FOUND[text(d["kind"])] ?? "what cannot be judged"}.`),
  "specimen.tried_again": (d, well) =>
    trouble(sentence(`${well} is measured again: attempt ${String(d["attempt"])} failed, ${text(d["why"])}`)),
  "specimen.unasked": (d) =>
    d["there"] === true
      ? trouble("The sampler's sensor shows a specimen that no run asked for. Take it out.")
      : news("The specimen that no run asked for is gone."),
  "specimen.interrupted": (d, well) =>
    trouble(
      `${well} was interrupted${d["reason"] ? ` (${reasonWords(text(d["reason"]))})` : ""}: ` +
        (d["kept"] === true
          ? "it stays in the capillary, and the run continues with it."
          : d["policy"] === "redo"
            ? "it is measured again from the start."
            : "it is given up."),
    ),
  "specimen.recovering": (_, well) => news(`${well}: its numbers are computed from the stored frames.`),
  "specimen.recovered": (_, well) => news(`${well}: its numbers were computed from the stored frames.`),
  "specimen.done": done,
  // An early journal has no meaning of a fault.
  "fault.raised": (d) => trouble(said([d["meaning"], d["message"]]) || "A fault was raised."),
  "fault.acknowledged": (d) => news(`${asked(d)} acknowledged the fault ${words(text(d["code"]))}.`),
  "fault.cleared": (d) => news(sentence(`a fault is over${d["why"] ? `: ${text(d["why"])}` : ""}`)),
  "daemon.stopping": () => trouble("The program was told to end while the run was open."),
  "store.regained": () => news("The disk takes writes again."),
};

function news(words: string): Entry {
  return { weight: "news", words };
}

function step(words: string): Entry {
  return { weight: "step", words };
}

function trouble(words: string): Entry {
  return { weight: "trouble", words };
}

/** Who asked for something, and from where. Without a name: what is known of the client. */
function asked(data: Data, field: "by" | "name" = "by"): string {
  const [by, from] = [text(data[field]), text(data["from"])];
  if (by) return from ? `${by} (${from})` : by;
  return from ? `A client at ${from} (no name given)` : "A command without a known source";
}

function heldBy(data: Data): string {
  return text(data["cause"]) || words(text(data["code"])) || "a fault";
}

function done(data: Data, well: string): Entry {
  const outcome = text(data["outcome"]) as SpecimenOutcome;
  const volume = data["volume_um3"];
  const said = [`${well}: ${DONE[outcome] ?? "ended"}`];
  const flags = Array.isArray(data["flags"]) ? (data["flags"] as string[]) : [];
  if (typeof volume === "number") {
    const sd = data["volume_sd_um3"];
    said.push(
      isBoundBy(flags)
        ? `, at least ${nanolitres(volume)}`
        : `, ${nanolitres(volume, typeof sd === "number" ? sd : null)}`,
    );
  }
  if (typeof data["reason"] === "string") said.push(`: ${reasonWords(data["reason"]).replace(/\.$/, "")}`);
  if (flags.length > 0) said.push(` (${flags.map(flagWords).join("; ")})`);
  const seconds = data["seconds"];
  if (typeof seconds === "number") said.push(`, after ${duration(seconds)}`);
  const isTrouble = outcome === "failed" || outcome === "interrupted" || flags.length > 0;
  return { weight: isTrouble ? "trouble" : "news", words: `${said.join("")}.` };
}

/** An event in words. A kind that this page does not know is named as it is. Pure. */
export function entryOf({ kind, well, data }: RunEvent): Entry {
  const known = WORDS[kind];
  const fields = typeof data === "object" && data !== null ? (data as Data) : {};
  return (
    known?.(fields, well ?? "a well") ??
    step(`${capitalised(words(kind.replace(".", ": ")))}${well ? `, ${well}` : ""}.`)
  );
}

export class RunLog {
  readonly #panel: HTMLDetailsElement;
  readonly #list: HTMLElement;
  readonly #words: HTMLElement;
  readonly #withSteps: HTMLInputElement;
  readonly #follow = new Latest(() => this.#read());
  #run: RunStatus | null = null;
  #of = "";
  #revision = -1;
  #events: RunEvent[] = [];
  /** Whether the events of the run have been read at least once. */
  #isRead = false;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#panel = find("log");
    this.#list = find("log-list");
    this.#words = find("log-words");
    this.#withSteps = find("log-steps");
    this.#panel.addEventListener("toggle", () => void this.#follow.ask());
    this.#withSteps.addEventListener("change", () => this.#draw());
  }

  /** `revision` is that of the status: nothing can have happened while it stays. */
  update(run: RunStatus | null, revision: number): void {
    show(this.#panel, run !== null);
    const key = run === null ? "" : runKey(run);
    if (key === this.#of && revision === this.#revision) return;
    if (key !== this.#of) {
      this.#events = [];
      this.#isRead = false;
      this.#draw();
    }
    this.#run = run;
    this.#of = key;
    this.#revision = revision;
    if (this.#panel.open) void this.#follow.ask();
  }

  async #read(): Promise<void> {
    const [run, of] = [this.#run, this.#of];
    if (run === null || !this.#panel.open) return;
    try {
      for (let next: number | null = this.#events.at(-1)?.id ?? 0; next !== null;) {
        const page = await fetchRunEvents(run.id, next);
        // Another run was opened meanwhile.
        if (this.#of !== of) return;
        // A run of the same name may have been there before.
        this.#events.push(...page.events.filter((event) => Date.parse(event.time) >= Date.parse(run.started) - 1000));
        next = page.next;
      }
      this.#isRead = true;
      this.#draw();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      setText(this.#words, `The events could not be read: ${error.message}.`);
    }
  }

  #draw(): void {
    const entries = this.#events.map((event) => ({ event, entry: entryOf(event) }));
    const shown = entries.filter(({ entry }) => this.#withSteps.checked || entry.weight !== "step").reverse();
    this.#list.replaceChildren(
      ...shown.map(({ event, entry }) => {
        const time = element("time", "quiet", moment(event.time));
        time.dateTime = event.time;
        const item = element(
          "li",
          entry.weight === "trouble" ? "log-trouble" : "",
          time,
          element("span", "", entry.words),
        );
        item.dataset["kind"] = event.kind;
        return item;
      }),
    );
    const hidden = entries.length - shown.length;
    setText(
      this.#words,
      entries.length === 0
        ? this.#isRead
          ? "No events of this run are kept."
          : "Loading the events …"
        : `${counted(shown.length, "event")}, the newest first${hidden === 0 ? "" : `; ${counted(hidden, "step")} not listed`}.`,
    );
  }
}
