// How the page is displayed: colours for light and dark rooms, the wall display, and what calls the operator.
//
//   ?wall in the address ──> wall display: state, count, finish, plate and frame, readable from some metres
//   theme, notices, sound ──> kept in this browser

import { byId, setText, show } from "./dom.ts";
import { callFor, type Call } from "./calls.ts";
import { remember, remembered } from "./remembered.ts";
import type { Status } from "./status.ts";

type Theme = "system" | "light" | "dark";

const THEME = "carved.theme";
const NOTICES = "carved.notices";
const SOUND = "carved.sound";

/** When the colours of the dark theme hold, by the operator's choice. */
const WHEN_DARK: Record<Theme, string> = { system: "(prefers-color-scheme: dark)", light: "not all", dark: "all" };

/** The rule of theme.css that has the colours of the dark theme. */
function darkRule(): CSSMediaRule {
  const rules = [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules]);
  const found = rules.find((rule) => rule instanceof CSSMediaRule && rule.conditionText === WHEN_DARK.system);
  if (found instanceof CSSMediaRule) return found;
  throw new Error("The style of this page has no dark theme.");
}

export class Display {
  readonly #notices = byId<HTMLInputElement>("with-notices");
  readonly #sound = byId<HTMLInputElement>("with-sound");
  readonly #words = byId("display-words");
  readonly #player = new Sound(byId("allow-sound"));
  #before: Status | null = null;

  constructor() {
    const dark = darkRule();
    const choice = byId<HTMLSelectElement>("theme");
    const paint = () => {
      dark.media.mediaText = WHEN_DARK[choice.value as Theme];
    };
    choice.value = remembered(THEME) ?? "system";
    choice.addEventListener("change", () => {
      remember(THEME, choice.value);
      paint();
    });
    paint();
    document.body.classList.toggle("wall", new URL(location.href).searchParams.has("wall"));

    this.#notices.checked = remembered(NOTICES) === "on" && mayNotify() === "granted";
    this.#sound.checked = remembered(SOUND) === "on";
    if (this.#sound.checked) this.#player.on();
    this.#notices.addEventListener("change", () => void this.#allow());
    this.#sound.addEventListener("change", () => {
      remember(SOUND, this.#sound.checked ? "on" : "off");
      if (this.#sound.checked) this.#player.on(() => this.#player.beep());
      else this.#player.off();
    });
  }

  /** Calls the operator if the instrument needs somebody now and did not before, or if a run has ended. */
  update(status: Status): void {
    const call = callFor(this.#before, status);
    this.#before = status;
    if (call === null) return;
    if (this.#notices.checked && !notify(call)) this.#refuse();
    this.#player.beep();
  }

  /** Notices are offered and permitted, but this browser shows none of a page, as Chrome on Android. */
  #refuse(): void {
    this.#notices.checked = false;
    remember(NOTICES, "off");
    setText(this.#words, "This browser shows no notices of a page. Use the sound, or another browser.");
  }

  async #allow(): Promise<void> {
    let allowed = mayNotify();
    if (this.#notices.checked && allowed === "default") allowed = await Notification.requestPermission();
    if (this.#notices.checked && allowed !== "granted") {
      this.#notices.checked = false;
      setText(
        this.#words,
        allowed === null
          ? "This browser offers notices only for pages at https or at this computer."
          : "This browser refuses notices from this page. Allow them in the settings of the browser.",
      );
    } else {
      setText(this.#words, "");
    }
    remember(NOTICES, this.#notices.checked ? "on" : "off");
  }
}

/** The browser's permission; null where it has no notices. */
function mayNotify(): NotificationPermission | null {
  return "Notification" in window ? Notification.permission : null;
}

/** Shows a notice. Returns whether the browser shows notices of a page. */
function notify({ title, words }: Call): boolean {
  try {
    // One notice at a time: a newer one replaces it.
    new Notification(title, { body: words, tag: "carved" });
    return true;
  } catch (error) {
    if (!(error instanceof TypeError)) throw error;
    return false;
  }
}

/**
 * Two short tones. A browser plays nothing before the first click on a page, so the context is made with the page and not with the first
 * alarm, and a button says while it must be allowed.
 */
class Sound {
  readonly #allow: HTMLElement;
  #audio: AudioContext | null = null;

  constructor(allow: HTMLElement) {
    this.#allow = allow;
    // Any click or key on the page allows it.
    for (const kind of ["click", "keydown"]) {
      window.addEventListener(kind, () => this.#resume(), { capture: true });
    }
  }

  /** `then` is called once the browser lets it play. */
  on(then: () => void = () => {}): void {
    this.#audio = new AudioContext();
    this.#audio.addEventListener("statechange", () => this.#explain());
    this.#explain();
    this.#resume(then);
  }

  off(): void {
    void this.#audio?.close();
    this.#audio = null;
    this.#explain();
  }

  beep(): void {
    const audio = this.#audio;
    if (audio === null || audio.state !== "running") return;
    const tone = audio.createOscillator();
    const volume = audio.createGain();
    volume.gain.value = 0.2;
    tone.frequency.setValueAtTime(660, audio.currentTime);
    tone.frequency.setValueAtTime(880, audio.currentTime + 0.18);
    tone.connect(volume).connect(audio.destination);
    tone.start();
    tone.stop(audio.currentTime + 0.36);
  }

  #resume(then: () => void = () => {}): void {
    // Pending until the browser allows it; refused once the context is closed.
    this.#audio?.resume().then(then, () => {});
  }

  #explain(): void {
    show(this.#allow, this.#audio !== null && this.#audio.state !== "running");
  }
}
