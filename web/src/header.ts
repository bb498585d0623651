// The top of the page: the instrument, whether it is simulated, and whether the page is up to date.

import type { Link } from "./connection.ts";
import { setText, show } from "./dom.ts";
import { clockTime, duration } from "./format.ts";
import { STATES } from "./plain.ts";
import type { Status } from "./status.ts";

export class HeaderView {
  readonly #stamp: HTMLElement;
  readonly #version: HTMLElement;
  readonly #instrument: HTMLElement;
  readonly #link: HTMLElement;
  readonly #lost: HTMLElement;
  #state: Link = { kind: "connecting" };
  #received: { at: number; serverTime: string } | null = null;

  constructor(root: Record<"stamp" | "version" | "instrument" | "link" | "lost", HTMLElement>) {
    this.#stamp = root.stamp;
    this.#version = root.version;
    this.#instrument = root.instrument;
    this.#link = root.link;
    this.#lost = root.lost;
    setInterval(() => this.#say(), 1000);
  }

  status(status: Status): void {
    show(this.#stamp, status.mode === "simulated");
    setText(this.#version, status.version);
    const { name, serial, location, uuid } = status.instrument;
    setText(this.#instrument, location === null ? name : `${name}, ${location}`);
    this.#instrument.title = `${serial === null ? "" : `Serial number ${serial}, `}uuid ${uuid}`;
    document.title = `${status.mode === "simulated" ? "SIMULATED " : ""}${STATES[status.state]} – ${name} – carved`;
    this.#received = { at: performance.now(), serverTime: status.server_time };
    this.#say();
  }

  link(link: Link): void {
    this.#state = link;
    document.body.classList.toggle("stale", link.kind === "lost");
    this.#say();
  }

  #say(): void {
    const kind = this.#state.kind;
    this.#link.dataset["link"] = kind;
    setText(this.#link, this.#linkWords());
    show(this.#lost, kind === "lost");
    if (this.#state.kind === "lost") setText(this.#lost, this.#lostWords(this.#state.why));
  }

  #linkWords(): string {
    switch (this.#state.kind) {
      case "connecting":
        return "Connecting…";
      case "live":
        return "Live";
      case "silent":
        return `No answer for ${duration((performance.now() - this.#state.since) / 1000)}`;
      case "lost":
        return "Connection lost";
    }
  }

  #lostWords(why: string): string {
    const head = `Connection lost: ${why}. `;
    if (!this.#received) return `${head}No status has come yet. Trying again.`;
    const age = duration((performance.now() - this.#received.at) / 1000);
    return `${head}What is shown below is ${age} old (from ${clockTime(this.#received.serverTime)}) and may no longer hold. Trying again.`;
  }
}
