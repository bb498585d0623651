// How the page is displayed: colours for light and dark rooms, the wall display, and what calls the operator.
//
//   ?wall in the address ──> wall display: state, count, finish, plate and frame, readable from some metres
//   theme, notices, sound ──> kept in this browser

import { byId, setText } from "./dom.ts";
import { callFor, type Call } from "./calls.ts";
import type { Status } from "./status.ts";

type Theme = "system" | "light" | "dark";

const THEME = "carved.theme";
const NOTICES = "carved.notices";
const SOUND = "carved.sound";

export class Display {
  readonly #notices = byId<HTMLInputElement>("with-notices");
  readonly #sound = byId<HTMLInputElement>("with-sound");
  readonly #words = byId("display-words");
  #before: Status | null = null;

  constructor() {
    const dark = matchMedia("(prefers-color-scheme: dark)");
    const choice = byId<HTMLSelectElement>("theme");
    const paint = () => {
      const theme = choice.value as Theme;
      document.documentElement.dataset["theme"] = theme === "system" ? (dark.matches ? "dark" : "light") : theme;
    };
    choice.value = localStorage.getItem(THEME) ?? "system";
    choice.addEventListener("change", () => {
      localStorage.setItem(THEME, choice.value);
      paint();
    });
    dark.addEventListener("change", paint);
    paint();
    document.body.classList.toggle("wall", new URL(location.href).searchParams.has("wall"));

    this.#notices.checked = localStorage.getItem(NOTICES) === "on" && mayNotify() === "granted";
    this.#sound.checked = localStorage.getItem(SOUND) === "on";
    this.#notices.addEventListener("change", () => void this.#allow());
    this.#sound.addEventListener("change", () => {
      localStorage.setItem(SOUND, this.#sound.checked ? "on" : "off");
      if (this.#sound.checked) beep();
    });
  }

  /** Calls the operator if the instrument needs somebody now and did not before, or if a run has ended. */
  update(status: Status): void {
    const call = callFor(this.#before, status);
    this.#before = status;
    if (call === null) return;
    if (this.#notices.checked && !notify(call)) this.#refuse();
    if (this.#sound.checked) beep();
  }

  /** Notices are offered and permitted, but this browser shows none of a page, as Chrome on Android. */
  #refuse(): void {
    this.#notices.checked = false;
    localStorage.setItem(NOTICES, "off");
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
    localStorage.setItem(NOTICES, this.#notices.checked ? "on" : "off");
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

/** Two short tones. A browser that wants a click first stays silent. */
function beep(): void {
  const audio = new AudioContext();
  const tone = audio.createOscillator();
  const volume = audio.createGain();
  volume.gain.value = 0.2;
  tone.frequency.setValueAtTime(660, audio.currentTime);
  tone.frequency.setValueAtTime(880, audio.currentTime + 0.18);
  tone.connect(volume).connect(audio.destination);
  tone.start();
  tone.stop(audio.currentTime + 0.36);
  tone.addEventListener("ended", () => void audio.close());
}
