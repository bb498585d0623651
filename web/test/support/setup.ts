// The real `carved setup --listen` on an emulated rig, as a child process of the test.

import { spawn, type ChildProcess } from "node:child_process";
import { once } from "node:events";
import { mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { BINARY } from "./daemon.ts";

/** How long it may take to say where it listens, and to end. */
const START_MS = 60_000;
const END_MS = 20_000;

export class SetUp {
  readonly url: string;
  readonly folder: string;
  readonly #child: ChildProcess;
  readonly #said: string[];

  private constructor(url: string, folder: string, child: ChildProcess, said: string[]) {
    this.url = url;
    this.folder = folder;
    this.#child = child;
    this.#said = said;
  }

  /** Starts it; with the folder of an interrupted one it goes on. */
  static async start(folder?: string): Promise<SetUp> {
    const where = folder ?? (await mkdtemp(join(tmpdir(), "carved-setup-")));
    const args = [
      "setup",
      "--simulate",
      "--time-scale",
      "10",
      "--listen",
      "127.0.0.1:0",
      "--out",
      join(where, "rig.toml"),
    ];
    const child = spawn(BINARY, args, { stdio: ["ignore", "pipe", "pipe"] });
    const said: string[] = [];
    let timer: NodeJS.Timeout | undefined;
    const url = await new Promise<string>((resolve, reject) => {
      const fail = (why: string) => reject(new Error(`${BINARY} ${args.join(" ")}: ${why}\n${said.join("\n")}`));
      timer = setTimeout(() => fail(`did not say where it listens within ${START_MS / 1000} s`), START_MS);
      for (const stream of [child.stdout, child.stderr]) {
        createInterface({ input: stream }).on("line", (line) => {
          said.push(line);
          const found = /http:\/\/[0-9.:]+/.exec(line);
          if (found) resolve(found[0]);
        });
      }
      child.once("error", (error) => fail(error.message));
      child.once("exit", (code) => fail(`ended with ${code}`));
    }).finally(() => clearTimeout(timer));
    return new SetUp(url, where, child, said);
  }

  /** The configuration that it has written. */
  config(): Promise<string> {
    return readFile(join(this.folder, "rig.toml"), "utf8");
  }

  get log(): string {
    return this.#said.slice(-60).join("\n");
  }

  /** Waits for its end by itself. */
  async ended(): Promise<number | null> {
    const child = this.#child;
    if (child.exitCode === null && child.signalCode === null) {
      await once(child, "exit", { signal: AbortSignal.timeout(END_MS) });
    }
    return child.exitCode;
  }

  async kill(): Promise<void> {
    const child = this.#child;
    if (child.exitCode === null && child.signalCode === null) {
      const ended = once(child, "exit");
      child.kill("SIGKILL");
      await ended;
    }
  }

  async remove(): Promise<void> {
    await this.kill();
    await rm(this.folder, { recursive: true, force: true });
  }
}
