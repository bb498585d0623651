// The commands of an operator to a run and to the instrument: rows of buttons, with a question before irreversible actions.

import { post, Refused, sayLoaded, sayNotMoved, Unanswered } from "./api.ts";
import { Asker, type Question } from "./ask.ts";
import { setText, show } from "./dom.ts";
import { Undo } from "./undo.ts";
import {
  canAbort,
  canGoOn,
  canHold,
  canStop,
  goesOnByItself,
  handedOver,
  isAtRest,
  mayStillCome,
  nextStep,
  runsNow,
  underWay,
} from "./plain.ts";
import { byPerson, NameRequest } from "./person.ts";
import type { Status } from "./status.ts";

interface Command {
  /** The text of the button. */
  name: string;
  label: (status: Status) => string;
  /** The button's label while the command is under way. */
  underWay: string;
  isUnderWay: (status: Status) => boolean;
  isShown: (status: Status) => boolean;
  isEnabled: (status: Status) => boolean;
  question: ((status: Status, run: string) => Omit<Question, "yes" | "ends">) | null;
  send: (status: Status, run: string) => Promise<void>;
  /** Whether it is sent after a few seconds, in which it can be undone. */
  canBeUndone?: true;
  /** Whether its event names the person. */
  isNamed?: true;
  /** Whether the command ends the run. */
  ends: boolean;
  /** What to do if the command fails. */
  otherwise: string;
}

const HALT = "Use the instrument's own emergency stop if it must halt now.";
/** The key that reports an exchange by hand. */
const NEXT_KEY = "n";
const never = () => false;
const always = () => true;
const steer = (name: string) => (_: Status, run: string) =>
  post(`/v1/runs/${encodeURIComponent(run)}/${name}${byPerson()}`);

const COMMANDS: readonly Command[] = [
  {
    name: "acknowledge",
    label: () => "Acknowledge",
    underWay: "",
    isUnderWay: never,
    isShown: (s) => nextStep(s)?.button === "acknowledge",
    isEnabled: always,
    question: null,
    send: (s) => post(`/v1/faults/${nextStep(s)?.fault}/acknowledge${byPerson()}`),
    isNamed: true,
    ends: false,
    otherwise: "The fault is still open.",
  },
  {
    name: "hold",
    // A run that a fault holds would continue by itself.
    label: (s) => (goesOnByItself(s) ? "Keep it held" : "Hold"),
    underWay: "Holding…",
    isUnderWay: (s) => s.pending.hold || s.state === "Holding",
    isShown: (s) => runsNow(s) && (goesOnByItself(s) || (s.state !== "Held" && s.state !== "Unholding")),
    isEnabled: canHold,
    question: null,
    send: steer("hold"),
    isNamed: true,
    ends: false,
    otherwise: "",
  },
  {
    name: "unhold",
    label: () => "Go on",
    underWay: "Going on…",
    isUnderWay: (s) => s.state === "Unholding",
    isShown: (s) => canGoOn(s) || (runsNow(s) && s.state === "Unholding"),
    isEnabled: canGoOn,
    question: null,
    send: steer("unhold"),
    isNamed: true,
    ends: false,
    otherwise: "The run is still held.",
  },
  {
    name: "stop",
    label: (s) => (isAtRest(s) ? "End the run" : "Stop after this well"),
    underWay: "Stopping…",
    isUnderWay: (s) => s.pending.stop,
    isShown: runsNow,
    isEnabled: canStop,
    question: (s, run) => ({
      title: isAtRest(s) ? `End run ${run}?` : `Stop run ${run} after this well?`,
      words: `${isAtRest(s) ? "The run ends here." : "The specimen under way is measured, then the run ends."} Wells that were not visited stay without numbers.`,
      no: isAtRest(s) ? "Keep the run" : "Keep running",
    }),
    send: steer("stop"),
    isNamed: true,
    ends: true,
    otherwise: "The run is not ended.",
  },
  {
    name: "abort",
    label: () => "Abort run",
    underWay: "Aborting…",
    isUnderWay: (s) => s.pending.abort || s.state === "Aborting",
    isShown: runsNow,
    isEnabled: canAbort,
    question: (s, run) => ({
      title: `Abort run ${run}?`,
      words: `The motors stop at once and the run ends as aborted. Wells that are finished are kept; ${underWay(s)?.in_capillary === true ? "the specimen in the capillary is not measured" : "wells that were not visited stay without numbers"}.`,
      no: s.state === "Held" ? "Leave it held" : "Keep running",
    }),
    send: steer("abort"),
    isNamed: true,
    ends: true,
    otherwise: HALT,
  },
  {
    name: "is-out",
    label: (s) => `Specimen of ${s.plate.take_out ?? ""} is out${mayStillCome(s) ? ", or will not come" : ""}`,
    underWay: "",
    isUnderWay: never,
    isShown: (s) => s.plate.take_out !== null && s.run !== null,
    isEnabled: always,
    question: null,
    canBeUndone: true,
    send: (s, run) => sayLoaded(run, s.plate.take_out ?? "", false),
    ends: false,
    otherwise: "It still counts as being in the capillary.",
  },
  {
    name: "is-in",
    label: (s) => `Specimen of ${s.plate.bring ?? ""} is in`,
    underWay: "",
    isUnderWay: never,
    // One step after the other: first the specimen before is taken out.
    isShown: (s) => s.plate.bring !== null && s.plate.take_out === null && s.run !== null,
    isEnabled: always,
    question: null,
    canBeUndone: true,
    send: (s, run) => sayLoaded(run, s.plate.bring ?? "", true),
    ends: false,
    otherwise: "The run still waits for it.",
  },
  {
    name: "not-moved",
    // The label contains the barcode: an answer about one plate must not apply to the next.
    label: (s) => `Plate ${handedOver(s) ?? ""} was not moved`,
    underWay: "",
    isUnderWay: never,
    isShown: (s) => handedOver(s) !== null,
    isEnabled: always,
    question: (s) => ({
      title: `Call the handover of plate ${handedOver(s) ?? ""} off?`,
      words:
        "A loader has announced that it moves this plate, and has not said how that ended. Say so only where the plate is where it was, and no loader is about to move it. A loader that works says so itself.",
      no: "Wait for the loader",
    }),
    send: () => sayNotMoved(),
    ends: false,
    otherwise: "The plate still counts as being handed over.",
  },
];

export class CommandRow {
  readonly #buttons: [Command, HTMLButtonElement][];
  readonly #asker: Asker;
  readonly #undo: Undo;
  readonly #who: NameRequest;
  /** Resolves with the first status that the report by key waits for. */
  #awaited: { meets: (status: Status) => boolean; resolve: () => void } | null = null;
  readonly #answer: HTMLElement;
  readonly #section: HTMLElement;
  #asked: { command: Command; label: string } | null = null;
  #newest: Status | null = null;
  #attempts = 0;
  /** Whether the last answer has taken effect. */
  #isOver: (status: Status) => boolean = always;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#buttons = COMMANDS.map((command) => [command, find<HTMLButtonElement>(command.name)]);
    this.#asker = new Asker(find);
    this.#undo = new Undo(find);
    this.#who = new NameRequest(find);
    document.addEventListener("keydown", (event) => {
      const isTyped = event.target instanceof Element && event.target.closest("input, select, textarea") !== null;
      if (event.key.toLowerCase() !== NEXT_KEY || event.repeat || event.ctrlKey || event.altKey || event.metaKey)
        return;
      if (!isTyped && this.#asked === null && !this.#undo.isOpen) void this.#next();
    });
    this.#answer = find("answer");
    this.#section = find("now");
    for (const [command, button] of this.#buttons) {
      button.addEventListener("click", (event) => {
        // The next step may come to the place of the one before: the second click of a double click is not meant for it.
        if (event.detail < 2) void this.#clicked(command, button);
      });
    }
  }

  update(status: Status): void {
    const another = (status.run?.id ?? null) !== (this.#newest?.run?.id ?? null);
    this.#newest = status;
    if (another || this.#isOver(status)) show(this.#answer, false);
    // An answer about a run that has ended meanwhile, or about another well, must not apply to the next one.
    const asked = this.#asked;
    if (asked && (another || !asked.command.isShown(status) || asked.command.label(status) !== asked.label)) {
      this.#asker.dismiss();
      this.#undo.dismiss();
    } else if (asked) {
      const question = this.#question(asked.command, status);
      if (question !== null) this.#asker.reword(question);
    }
    if (this.#awaited?.meets(status) === true) {
      this.#awaited.resolve();
      this.#awaited = null;
    }
    const focused = document.activeElement;
    const next = nextStep(status)?.button;
    for (const [command, button] of this.#buttons) {
      show(button, command.isShown(status));
      button.classList.toggle("button-next", command.name === next);
      button.disabled = !command.isEnabled(status);
      setText(button, command.isUnderWay(status) ? command.underWay : command.label(status));
      if (button === focused && (button.hidden || button.disabled)) this.#giveFocus(button);
    }
  }

  #question(command: Command, status: Status): Question | null {
    const asked = command.question?.(status, status.run?.id ?? "");
    return asked ? { ...asked, yes: command.label(status), ends: command.ends } : null;
  }

  /** Gives the focus to a button, or to its section if the button cannot take it. */
  #giveFocus(button: HTMLElement): void {
    button.focus({ preventScroll: true });
    if (document.activeElement !== button || button.matches(":disabled, [hidden]"))
      this.#section.focus({ preventScroll: true });
  }

  async #clicked(command: Command, button: HTMLButtonElement): Promise<void> {
    const status = this.#newest;
    if (!status || !command.isShown(status)) return;
    const run = status.run?.id ?? "";
    const label = command.label(status);
    const question = this.#question(command, status);
    if (question !== null || command.canBeUndone === true) {
      this.#asked = { command, label };
      const yes = await (question === null ? this.#undo.wait(label) : this.#asker.ask(question));
      this.#asked = null;
      if (!yes) {
        if (isFocusLost()) this.#giveFocus(button);
        return;
      }
    }
    button.disabled = true;
    const at = (s: Status) => `${s.state} ${s.plate.needs} ${handedOver(s)} ${nextStep(s)?.fault}`;
    const moved = (now: Status) => at(now) !== at(status);
    try {
      await command.send(status, run);
      if (command.isNamed === true) this.#who.commanded();
      this.#say(`${label}: accepted.`, (now) => moved(now) && !command.isUnderWay(now));
    } catch (error) {
      this.#say(refusal(label, error, command), moved);
    }
    this.update(this.#newest ?? status);
    if (isFocusLost()) this.#giveFocus(button);
  }

  /** Reports by one key that the specimen is out and the next one is in, or the one of both that is asked for. */
  async #next(): Promise<void> {
    const status = this.#newest;
    const run = status?.run?.id;
    const { take_out: out, bring } = status?.plate ?? { take_out: null, bring: null };
    if (status == null || run == null || (out === null && bring === null)) return;
    const parts = [out === null ? "" : `${out} is out`, bring === null ? "" : `${bring} is in`];
    const label = parts.filter((part) => part !== "").join(" and ");
    const same = (s: Status) => s.run?.id === run && s.plate.take_out === out && s.plate.bring === bring;
    if (!(await this.#undo.wait(label)) || this.#newest === null || !same(this.#newest)) return;
    try {
      if (out !== null) await sayLoaded(run, out, false);
      if (bring !== null) {
        // Only once the run asks for it alone.
        const asks = (s: Status) => s.run?.id !== run || s.plate.take_out === null;
        if (!asks(this.#newest))
          await new Promise<void>((resolve) => {
            this.#awaited = { meets: asks, resolve };
          });
        if (this.#newest.run?.id === run && this.#newest.plate.bring === bring) await sayLoaded(run, bring, true);
      }
      this.#say(`${label}: accepted.`, (now) => !same(now));
    } catch (error) {
      this.#say(`${label} did not get through: ${reason(error)}.`, (now) => !same(now));
    }
  }

  /** Shows why no run was started, until the run that is under way has ended. */
  tell(words: string): void {
    this.#say(words, (now) => !runsNow(now));
  }

  /** Shows the refusal of an action that is no command, until it is repeated. */
  async attempt(refused: string, job: () => Promise<void>): Promise<void> {
    const own = (this.#attempts += 1);
    if (this.#newest) this.update(this.#newest);
    try {
      await job();
    } catch (error) {
      this.#say(`${refused}: ${reason(error)}.`, () => own !== this.#attempts);
    }
  }

  #say(words: string, isOver: (status: Status) => boolean): void {
    this.#isOver = isOver;
    setText(this.#answer, words.trim());
    show(this.#answer, true);
  }
}

/** What to say of a command that failed. One without an answer may still be carried out. */
function refusal(label: string, error: unknown, { otherwise, ends }: Command): string {
  if (!(error instanceof Unanswered)) return `${label} did not get through: ${reason(error)}. ${otherwise}`;
  const advice = ends ? ` ${HALT}` : "";
  return `${label}: ${error.message}. It may still be carried out.${advice}`;
}

/** Whether the focus was in a question that is closed, or on a button that is disabled. */
function isFocusLost(): boolean {
  const active = document.activeElement;
  return active === null || active === document.body || active.closest("dialog, :disabled") !== null;
}

function reason(error: unknown): string {
  return error instanceof Refused ? error.message : String(error);
}
