// What the operator can tell a run and the instrument: one row of buttons, one question before what cannot be taken back.

import { post, Refused } from "./api.ts";
import { setText, show } from "./dom.ts";
import { canAbort, canGoOn, canHold, canStop, isHeldByFaultAlone, runsNow } from "./plain.ts";
import type { Status } from "./status.ts";

interface Question {
  title: string;
  words: string;
  no: string;
}

interface Command {
  /** Of its button, and in its path under the run. */
  name: string;
  label: string;
  /** In the button's place of the label while it is under way. */
  underWay: string;
  isUnderWay: (status: Status) => boolean;
  isShown: (status: Status) => boolean;
  isEnabled: (status: Status) => boolean;
  question: Question | null;
  /** What to do where it did not get through. */
  otherwise: string;
}

const COMMANDS: readonly Command[] = [
  {
    name: "hold",
    label: "Hold",
    underWay: "Holding…",
    isUnderWay: (s) => s.pending.hold || s.state === "Holding",
    isShown: (s) => runsNow(s) && (isHeldByFaultAlone(s) || (s.state !== "Held" && s.state !== "Unholding")),
    isEnabled: canHold,
    question: null,
    otherwise: "The run goes on.",
  },
  {
    name: "unhold",
    label: "Go on",
    underWay: "Going on…",
    isUnderWay: (s) => s.state === "Unholding",
    isShown: (s) => runsNow(s) && (s.state === "Held" || s.state === "Unholding"),
    isEnabled: canGoOn,
    question: null,
    otherwise: "The run is still held.",
  },
  {
    name: "stop",
    label: "Stop after this well",
    underWay: "Stopping…",
    isUnderWay: (s) => s.pending.stop,
    isShown: runsNow,
    isEnabled: canStop,
    question: {
      title: "Stop run {run} after this well?",
      words: "The specimen under way is measured, then the run ends. Wells that were not visited stay without numbers.",
      no: "Keep running",
    },
    otherwise: "The run goes on.",
  },
  {
    name: "abort",
    label: "Abort run",
    underWay: "Aborting…",
    isUnderWay: (s) => s.pending.abort || s.state === "Aborting",
    isShown: runsNow,
    isEnabled: canAbort,
    question: {
      title: "Abort run {run}?",
      words:
        "The motors stop at once and the run ends as aborted. Wells that are finished are kept; the specimen in the capillary is not measured.",
      no: "Keep running",
    },
    otherwise: "Use the instrument's own emergency stop if it must halt now.",
  },
];

export class CommandRow {
  readonly #buttons: [Command, HTMLButtonElement][];
  readonly #emergency: HTMLButtonElement;
  readonly #dialog: HTMLDialogElement;
  readonly #title: HTMLElement;
  readonly #words: HTMLElement;
  readonly #no: HTMLElement;
  readonly #yes: HTMLElement;
  readonly #answer: HTMLElement;
  #asked: Command | null = null;
  #run: string | null = null;
  #newest: Status | null = null;

  constructor(find: <T extends Element = HTMLElement>(id: string) => T) {
    this.#buttons = COMMANDS.map((command) => [command, find<HTMLButtonElement>(command.name)]);
    this.#emergency = find("emergency-stop");
    this.#dialog = find("ask");
    this.#title = find("ask-title");
    this.#words = find("ask-words");
    this.#no = find("ask-no");
    this.#yes = find("ask-yes");
    this.#answer = find("answer");
    for (const [command, button] of this.#buttons) button.addEventListener("click", () => this.#clicked(command));
    this.#emergency.addEventListener("click", () => void this.#emergencyStop());
    this.#dialog.addEventListener("close", () => {
      const asked = this.#asked;
      this.#asked = null;
      if (asked && this.#dialog.returnValue === "yes") void this.#send(asked);
      this.#dialog.returnValue = "";
    });
  }

  update(status: Status): void {
    this.#newest = status;
    const another = (status.run?.id ?? null) !== this.#run;
    this.#run = status.run?.id ?? null;
    if (another) show(this.#answer, false);
    // A question about a run that has ended meanwhile must not be answered for the next one.
    if ((another || !runsNow(status)) && this.#dialog.open) this.#dialog.close();
    for (const [command, button] of this.#buttons) {
      show(button, command.isShown(status));
      button.disabled = !command.isEnabled(status);
      setText(button, command.isUnderWay(status) ? command.underWay : command.label);
    }
  }

  #clicked(command: Command): void {
    if (command.question === null) {
      void this.#send(command);
      return;
    }
    this.#asked = command;
    setText(this.#title, command.question.title.replace("{run}", this.#run ?? ""));
    setText(this.#words, command.question.words);
    setText(this.#no, command.question.no);
    setText(this.#yes, command.label);
    this.#dialog.showModal();
  }

  async #send(command: Command): Promise<void> {
    const run = this.#run;
    if (run === null) return;
    const button = this.#buttons.find(([c]) => c === command)?.[1];
    if (button) button.disabled = true;
    try {
      await post(`/v1/runs/${encodeURIComponent(run)}/${command.name}`);
      this.#say(`${command.label}: accepted for run ${run}.`);
    } catch (error) {
      this.#say(`${command.label} did not get through: ${reason(error)}. ${command.otherwise}`);
    }
    if (this.#newest) this.update(this.#newest);
  }

  async #emergencyStop(): Promise<void> {
    try {
      await post("/v1/emergency-stop");
      this.#say("Emergency stop: the motors were stopped. Acknowledge the fault below when the instrument is safe.");
    } catch (error) {
      this.#say(
        `The emergency stop did not get through: ${reason(error)}. Use the instrument's own emergency stop, or cut its power.`,
      );
    }
  }

  #say(words: string): void {
    setText(this.#answer, words);
    show(this.#answer, true);
  }
}

function reason(error: unknown): string {
  return error instanceof Refused ? error.message : String(error);
}
