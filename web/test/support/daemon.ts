// The real daemon on its emulated rig, as a child process of the test.

import assert from "node:assert/strict";
import { spawn, type ChildProcess } from "node:child_process";
import { once } from "node:events";
import { createServer, type AddressInfo } from "node:net";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { fileURLToPath } from "node:url";
import type { Status } from "../../src/status.ts";

export const BINARY =
  process.env["CARVED_BIN"] ?? fileURLToPath(new URL("../../../../target/debug/carved", import.meta.url));
/** The demo takes 120 s at most at time factor 1 in a release build; a test build on a busy machine gets as long. */
export const RUN_MS = 240_000;

/** How long the daemon may take to say where it listens, and to end. */
const START_MS = 60_000;
const END_MS = 10_000;

async function freePort(): Promise<number> {
  const server = createServer();
  server.listen(0, "127.0.0.1");
  await once(server, "listening");
  const { port } = server.address() as AddressInfo;
  server.close();
  await once(server, "close");
  return port;
}

export class Daemon {
  readonly url: string;
  /** Its data folder. It is removed with the end of the daemon. */
  readonly folder: string;
  readonly #command: readonly [string, readonly string[]];
  readonly #said: string[] = [];
  #child!: ChildProcess;

  private constructor(url: string, folder: string, command: readonly [string, readonly string[]]) {
    this.url = url;
    this.folder = folder;
    this.#command = command;
  }

  static async start(binary: string, timeScale: number, more: readonly string[] = []): Promise<Daemon> {
    const folder = await mkdtemp(join(tmpdir(), "carved-page-"));
    const url = `http://127.0.0.1:${await freePort()}`;
    const args = ["simulate", "--listen", url.slice("http://".length), "--data", folder];
    args.push("--time-scale", String(timeScale), ...more);
    const daemon = new Daemon(url, folder, [binary, args]);
    try {
      await daemon.#launch();
    } catch (error) {
      await daemon.stop();
      throw error;
    }
    return daemon;
  }

  async #launch(): Promise<void> {
    const [binary, args] = this.#command;
    const child = spawn(binary, args, { stdio: ["ignore", "pipe", "pipe"] });
    this.#child = child;
    let timer: NodeJS.Timeout | undefined;
    try {
      await new Promise<void>((resolve, reject) => {
        const fail = (why: string) =>
          reject(new Error(`${binary} ${args.join(" ")}: ${why}\n${this.#said.join("\n")}`));
        timer = setTimeout(() => fail(`did not say ${this.url} within ${START_MS / 1000} s`), START_MS);
        for (const stream of [child.stdout!, child.stderr!]) {
          createInterface({ input: stream }).on("line", (line) => {
            this.#said.push(line);
            if (line.includes(this.url)) resolve();
          });
        }
        child.once("error", (error) => fail(error.message));
        child.once("exit", (code) => fail(`ended with ${code}`));
      });
    } finally {
      clearTimeout(timer);
    }
  }

  /** Stops its process for a while (`SIGSTOP`), or lets it go on (`SIGCONT`). */
  signal(name: "SIGSTOP" | "SIGCONT"): void {
    assert.ok(this.#child.kill(name), `${name} was not delivered`);
  }

  /** Ends it as a crash does. */
  async crash(): Promise<void> {
    const ended = once(this.#child, "exit");
    this.#child.kill("SIGKILL");
    await ended;
  }

  /** Starts it again, at the same address with the same data. */
  async again(): Promise<void> {
    await this.#launch();
  }

  async status(after?: number): Promise<Status> {
    const wait = after === undefined ? "" : `?wait=5&after=${after}`;
    const response = await fetch(`${this.url}/v1/status${wait}`).catch((error: Error) => {
      const ended = `exit code ${this.#child.exitCode}, signal ${this.#child.signalCode}`;
      throw new Error(`no status (${String(error.cause)}; ${ended})\n${this.log}`, { cause: error });
    });
    assert.equal(response.status, 200);
    return (await response.json()) as Status;
  }

  /** Follows the status until `done`, and says what it was when time is up. */
  async follow(done: (status: Status) => boolean): Promise<Status> {
    const deadline = performance.now() + RUN_MS;
    let newest = await this.status();
    while (!done(newest)) {
      const told = `state ${newest.state}, doing ${newest.doing}, faults ${JSON.stringify(newest.faults)}`;
      assert.ok(performance.now() < deadline, `time is up: ${told}\n${this.log}`);
      newest = await this.status(newest.revision);
    }
    return newest;
  }

  /** What another client of the daemon sends. */
  async send(method: string, path: string, body?: unknown): Promise<void> {
    const json =
      body === undefined ? {} : { body: JSON.stringify(body), headers: { "Content-Type": "application/json" } };
    const response = await fetch(`${this.url}${path}`, { method, ...json });
    assert.ok(response.ok, `${method} ${path}: ${response.status} ${await response.text()}`);
  }

  /** What it wrote, for a failure's message. */
  get log(): string {
    return this.#said.slice(-60).join("\n");
  }

  /** Asks it to end as a service manager does; insists after a while. Gives its exit code. Its data stay. */
  async end(): Promise<number | null> {
    const child = this.#child;
    if (child.pid !== undefined && child.exitCode === null && child.signalCode === null) {
      const ended = once(child, "exit");
      child.kill("SIGTERM");
      const insist = setTimeout(() => child.kill("SIGKILL"), END_MS);
      await ended;
      clearTimeout(insist);
    }
    return child.exitCode;
  }

  /** Ends it, and removes its data. Gives its exit code. */
  async stop(): Promise<number | null> {
    const code = await this.end();
    await rm(this.folder, { recursive: true, force: true });
    return code;
  }
}
