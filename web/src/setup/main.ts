// The page of `carved setup --listen`: one question at a time, what was found, and a stop that always works.
//
//   GET /v1/setup?after=N ── View ──> stage, question, progress, log, answers     (again and again)
//                              └───> picture, when its number rises
//   form ── POST /v1/setup/answer {number, answer} ──> refused: the reason at the form
//   stop ── POST /v1/setup/stop ──> motors stop, light off, the end

import { byId, element, setText, show } from "../dom.ts";
import { authorization, TokenForm } from "../token.ts";
import { heading, hint, isTyped, type Choice, type Kind, type Question, type View } from "./view.ts";

/** Pause after a failed poll, ms. */
const AGAIN_MS = 1000;

const token = new TokenForm(byId("token-form"), byId("token"));
const form = byId<HTMLFormElement>("answer-form");
const input = byId("input");
const send = byId<HTMLButtonElement>("send");
const refused = byId("refused");
const picture = byId<HTMLImageElement>("picture");
const stopButton = byId<HTMLButtonElement>("stop");

let asked = 0;
let pictureShown = 0;
let logShown = 0;
let ended = false;
/** An answer is on its way. Its refusal may arrive after the same question with its next number. */
let waiting = false;

async function request(path: string, body?: unknown): Promise<Response> {
  const json =
    body === undefined
      ? {}
      : { method: "POST", body: JSON.stringify(body), headers: { "Content-Type": "application/json" } };
  const headers = { ...authorization(), ...("headers" in json ? json.headers : {}) };
  const response = await fetch(path, { ...json, cache: "no-store", headers });
  token.wanted(response.status === 401);
  return response;
}

/** The reason that a refusal gives. */
async function reason(response: Response): Promise<string> {
  const problem = (await response.json().catch(() => ({}))) as { detail?: string };
  return problem.detail ?? `${response.status} ${response.statusText}`;
}

function complain(text: string): void {
  setText(refused, text && !/[.?]$/.test(text) ? `${text}.` : text);
  show(refused, text !== "");
}

async function answer(text: string): Promise<void> {
  for (const button of form.querySelectorAll("button")) button.disabled = true;
  waiting = true;
  try {
    const response = await request("/v1/setup/answer", { number: asked, answer: text });
    complain(response.ok ? "" : await reason(response));
    // The question is asked again under another number, which the next answer needs.
    if (!response.ok) draw((await (await request("/v1/setup")).json()) as View);
  } catch {
    complain("The set-up cannot be reached");
  } finally {
    waiting = false;
    for (const button of form.querySelectorAll("button")) button.disabled = false;
  }
}

/** What the form holds. */
function given(): string {
  const chosen = input.querySelector<HTMLInputElement>("input[type=radio]:checked");
  const typed = input.querySelector<HTMLInputElement>("input[type=text]");
  if (chosen && chosen.value !== OTHER) return chosen.value;
  return typed ? typed.value : "yes";
}

/** Value of the choice whose answer is typed. */
const OTHER = "\u0000";

function textField(question: Question, value: string): HTMLElement {
  const field = element("input", "");
  field.type = "text";
  field.value = value;
  field.autocomplete = "off";
  field.spellcheck = false;
  field.setAttribute("aria-label", question.title);
  if (question.kind.form === "number") {
    field.inputMode = "decimal";
    return element("span", "with-unit", field, question.kind.unit);
  }
  return field;
}

function radio(choice: Choice, isChosen: boolean): HTMLElement {
  const button = element("input", "");
  button.type = "radio";
  button.name = "choice";
  button.value = choice.value;
  button.checked = isChosen;
  return element("label", "choice", button, element("span", "", choice.label));
}

function choices(question: Question, kind: Extract<Kind, { form: "choice" }>): HTMLElement[] {
  const isListed = kind.options.some((option) => option.value === question.default);
  const label = (option: Choice) => (kind.open ? `${option.value}: ${option.label}` : option.label);
  const made = kind.options.map((option) =>
    radio({ value: option.value, label: label(option) }, option.value === question.default),
  );
  if (!kind.open) return made;
  const field = textField(question, isListed ? "" : (question.default ?? ""));
  if (kind.options.length === 0) return [field];
  const other = radio({ value: OTHER, label: "Another:" }, !isListed && question.default !== null);
  field.addEventListener("input", () => (other.querySelector("input")!.checked = true));
  other.append(field);
  return [...made, other];
}

/** Builds the form of a new question. The fields of the same question stay as they are. */
function ask(question: Question): void {
  if (question.number === asked) return;
  // The same question again, because its answer was refused: what was typed stays.
  const isSame = form.dataset["id"] === question.id && question.problem === null && (waiting || !refused.hidden);
  asked = question.number;
  if (isSame) return;
  complain("");
  form.dataset["id"] = question.id;
  const { kind } = question;
  const below = hint(kind);
  const fields =
    kind.form === "choice"
      ? choices(question, kind)
      : isTyped(kind)
        ? [textField(question, question.default ?? "")]
        : [];
  input.replaceChildren(...fields, ...(below ? [element("small", "hint", below)] : []));
  setText(send, kind.form === "confirm" ? "Yes, go on" : "Next");
  const first = input.querySelector<HTMLInputElement>("input[type=radio]:checked, input[type=text]") ?? send;
  first.focus({ preventScroll: true });
  if (first instanceof HTMLInputElement && first.type === "text") first.select();
}

function stages(view: View): void {
  const items = view.stages.map((name, at) => {
    const item = element("li", at < view.stage ? "done" : at === view.stage ? "current" : "", name);
    if (at === view.stage) item.setAttribute("aria-current", "step");
    return item;
  });
  byId("stages").replaceChildren(...items);
}

async function showPicture(view: View): Promise<void> {
  if (view.picture === pictureShown) return;
  pictureShown = view.picture;
  const response = await request("/v1/setup/picture.jpg");
  if (!response.ok) return;
  const old = picture.src;
  picture.src = URL.createObjectURL(await response.blob());
  if (old) URL.revokeObjectURL(old);
  show(picture, true);
}

function draw(view: View): void {
  ended = view.ended !== null;
  setText(byId("file"), view.file);
  setText(byId("facts"), view.simulated ?? "");
  for (const id of ["stamp", "facts"]) show(byId(id), view.simulated !== null);
  stages(view);
  setText(byId("title"), heading(view));
  const { question } = view;
  setText(byId("problem"), question?.problem ? `${question.problem}.` : "");
  show(byId("problem"), Boolean(question?.problem));
  setText(byId("text"), question?.text ?? view.doing ?? "");
  const progress = byId<HTMLProgressElement>("progress");
  show(progress, view.doing !== null);
  if (view.taken) [progress.value, progress.max] = view.taken;
  else progress.removeAttribute("value");
  show(form, question !== null);
  if (question) ask(question);
  show(byId("back"), view.answers.length > 0);
  const taken = view.taken ? `Picture ${view.taken[0]} of ${view.taken[1]}.` : "The newest picture of the camera.";
  setText(byId("caption"), view.picture === 0 ? "No picture was taken yet." : taken);
  const log = byId("log");
  if (view.log.length !== logShown || log.lastElementChild?.textContent !== view.log.at(-1)) {
    logShown = view.log.length;
    log.replaceChildren(...view.log.map((line) => element("li", "", line)));
    log.scrollTop = log.scrollHeight;
  }
  byId("answers").replaceChildren(
    ...view.answers.map((one) => element("div", "", element("dt", "", one.title), element("dd", "", one.answer))),
  );
  setText(byId("ended"), view.ended?.text ?? "");
  show(byId("ended"), ended);
  byId("ended").dataset["done"] = String(view.ended?.is_done ?? false);
  show(byId("end"), view.ended?.is_done ?? false);
  show(stopButton, !ended);
  // A picture that cannot be fetched is fetched with the next one.
  showPicture(view).catch(() => undefined);
}

async function follow(): Promise<void> {
  let revision: number | null = null;
  while (!ended) {
    try {
      const response = await request(`/v1/setup${revision === null ? "" : `?after=${revision}`}`);
      if (!response.ok) throw new Error(await reason(response));
      const view = (await response.json()) as View;
      revision = view.revision;
      show(byId("lost"), false);
      draw(view);
    } catch (error) {
      if (ended) return;
      const why = error instanceof TypeError ? "" : ` (${(error as Error).message})`;
      setText(byId("lost"), `The set-up cannot be reached${why}. Look at the terminal in which it was started.`);
      show(byId("lost"), Boolean(byId("token-form").hidden));
      await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    }
  }
}

async function finish(path: string): Promise<void> {
  try {
    const response = await request(path, {});
    if (response.ok) draw((await response.json()) as View);
    if (path.endsWith("/end")) show(byId("end"), false);
  } catch {
    setText(byId("lost"), "The set-up cannot be reached. Press Ctrl-C in its terminal, or switch the motors off.");
    show(byId("lost"), true);
  }
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  void answer(given());
});
byId("back").addEventListener("click", () => void answer("back"));
stopButton.addEventListener("click", () => void finish("/v1/setup/stop"));
byId("end").addEventListener("click", () => void finish("/v1/setup/end"));
document.addEventListener("keydown", (event) => {
  if (event.key !== "F8" || event.repeat || ended) return;
  event.preventDefault();
  void finish("/v1/setup/stop");
});
void follow();
