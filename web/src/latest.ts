// Runs a task for the newest state only: never two at once, and once more if the state changed meanwhile.

import { Refused } from "./api.ts";

export class Latest {
  #running = false;
  #again = false;
  readonly #task: () => Promise<void>;

  constructor(task: () => Promise<void>) {
    this.#task = task;
  }

  async ask(): Promise<void> {
    if (this.#running) {
      this.#again = true;
      return;
    }
    this.#running = true;
    try {
      do {
        this.#again = false;
        await this.#task();
      } while (this.#again);
    } catch (error) {
      // If the daemon is away or busy, the connection shows it, and the next status repeats the task.
      if (!(error instanceof Refused)) throw error;
    } finally {
      this.#running = false;
    }
  }
}
