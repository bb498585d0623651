// A daemon's outside for the page's tests: status with long poll, live pictures, commands; nothing behind them.

import { createServer, type IncomingMessage, type Server, type ServerResponse } from "node:http";
import type { AddressInfo, Socket } from "node:net";
import { readFile } from "node:fs/promises";
import type { Links, Specimen, Status } from "../../src/status.ts";

const CSP =
  "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const PAGE: Record<string, [string, string]> = {
  "/": ["index.html", "text/html; charset=utf-8"],
  "/app.js": ["app.js", "text/javascript"],
  "/three.js": ["three.js", "text/javascript"],
  "/app.css": ["app.css", "text/css"],
  "/wall/": ["wall/index.html", "text/html; charset=utf-8"],
  "/wall/wall.js": ["wall/wall.js", "text/javascript"],
  "/wall/wall.css": ["wall/wall.css", "text/css"],
};

/** The file of a page of the documentation. Its style and its script are there as they are. */
function docsPage(path: string): [string, string] | undefined {
  const name = /^\/docs\/([\w-]+\.(html|json|css|js))$/.exec(path);
  const types: Record<string, string> = {
    html: "text/html",
    json: "application/json",
    css: "text/css",
    js: "text/javascript",
  };
  return name ? [`docs/${name[1]}`, `${types[name[2]!]}; charset=utf-8`] : undefined;
}

/** A specimen without files. */
export const NO_FILES: Links = {
  mesh_ply: null,
  mesh_glb: null,
  coloured_glb: null,
  lateral_png: null,
  lateral_tif: null,
  dorsal_png: null,
  dorsal_tif: null,
  detection: null,
  views: [],
  profiles: [],
};

/** A stored specimen; nothing of it, where nothing is said. */
export function kept(change: Partial<Specimen> = {}): Specimen {
  return {
    run: "demo-1",
    well: "A01",
    attempt: 1,
    earlier_attempts: [],
    result: null,
    recording: { rig: { camera: { f: 60_000, kx: 0.18, ky: 0.18, ux: 256, uy: 256, width: 512, height: 512 } } },
    measurement: null,
    hull_volumes_um3: [],
    estimates: [],
    links: { ...NO_FILES },
    ...change,
  };
}

export class FixtureServer {
  /** Commands that were taken: `POST /v1/runs/demo-1/abort`, with what came with them. */
  readonly taken: { command: string; body: string }[] = [];
  /** Queries of the status requests, oldest first. */
  readonly asked: string[] = [];
  /** Whether too many clients wait for a change of the status. */
  isFull = false;
  /** Paths and queries of what was read beside the status, oldest first. */
  readonly read: string[] = [];
  /** Answer to a command in place of 200: a problem in words, with what is wrong. */
  refusal: { code?: string; detail: string; errors?: object[]; run?: string } | null = null;
  /** Runs that were taken before: a start of one of them answers 200, of another one 201. */
  readonly known = new Set<string>();
  /** Whether commands get no answer, as from a daemon that hangs. */
  isSilent = false;
  /** Whether the status gets no answer. */
  isFrozen = false;
  /** Bodies of what is read, and of what commands answer, by path. */
  readonly answers: Record<string, unknown> = {};
  /** What cannot be read, by path, and why: answered 500. */
  readonly broken: Record<string, string> = {};
  /** What is answered only once its promise resolves, by path. */
  readonly slow: Record<string, Promise<void>> = {};
  /** Files of stored specimens, by path. */
  readonly files: Record<string, Buffer> = {};
  /** Wanted of everything under /v1, where set. */
  token: string | null = null;
  readonly live: Record<string, { body: Buffer; type: string } | undefined> = {};
  /** Whose the live pictures are. */
  shown = { run: "demo-1", well: "A02", views: 9 };
  #status: Status;
  #waiting = new Set<() => void>();
  #sockets = new Set<Socket>();
  #server: Server | null = null;
  #port = 0;

  constructor(first: Status) {
    this.#status = first;
  }

  get url(): string {
    return `http://127.0.0.1:${this.#port}`;
  }

  /** Publishes a status as the next revision. */
  publish(status: Status): void {
    this.#status = { ...status, revision: this.#status.revision + 1 };
    for (const wake of [...this.#waiting]) wake();
  }

  /** Starts, on a free port where none is asked for. */
  async start(port = this.#port): Promise<void> {
    const server = createServer((request, response) => void this.#answer(request, response));
    server.on("connection", (socket) => {
      this.#sockets.add(socket);
      socket.on("close", () => this.#sockets.delete(socket));
    });
    await new Promise<void>((resolve, reject) => {
      server.once("error", reject);
      server.listen(port, "127.0.0.1", resolve);
    });
    this.#port = (server.address() as AddressInfo).port;
    this.#server = server;
  }

  /** Goes away as a killed daemon does: every connection is cut. */
  async stop(): Promise<void> {
    const server = this.#server;
    this.#server = null;
    if (!server) return;
    const closed = new Promise<void>((resolve) => server.close(() => resolve()));
    for (const socket of this.#sockets) socket.destroy();
    await closed;
  }

  async #answer(request: IncomingMessage, response: ServerResponse): Promise<void> {
    const url = new URL(request.url ?? "/", this.url);
    const page = PAGE[url.pathname] ?? docsPage(url.pathname);
    if (page) {
      const file = new URL(`../../../dist/${page[0]}`, import.meta.url);
      const packed = await readFile(new URL(`${file.href}.gz`)).catch(() => null);
      // As the daemon has it: the page of several instruments reads from others.
      const csp = url.pathname === "/wall/" ? CSP.replace("connect-src 'self'", "connect-src http: https:") : CSP;
      const encoding = packed === null ? {} : { "Content-Encoding": "gzip" };
      response.writeHead(200, { "Content-Type": page[1], ...encoding, "Content-Security-Policy": csp });
      response.end(packed ?? (await readFile(file)));
    } else if (this.token !== null && request.headers.authorization !== `Bearer ${this.token}`) {
      this.#json(response, 401, { title: "Unauthorized", detail: "send the instrument's token" });
    } else if (url.pathname === "/v1/status") {
      this.asked.push(url.search);
      if (this.isFull && url.searchParams.has("wait")) {
        this.#json(response, 503, { title: "Service Unavailable", code: "busy", detail: "too many clients wait" });
        return;
      }
      if (this.isFrozen) return;
      await this.#settled(url);
      this.#json(response, 200, this.#status);
    } else if (request.method === "POST" || request.method === "PUT") {
      const chunks: Buffer[] = [];
      for await (const chunk of request) chunks.push(chunk as Buffer);
      if (this.isSilent) return;
      if (this.refusal !== null) {
        this.#json(response, 409, { title: "Conflict", ...this.refusal });
        return;
      }
      this.taken.push({
        command: `${request.method} ${decodeURIComponent(url.pathname)}`,
        body: Buffer.concat(chunks).toString(),
      });
      const run = request.method === "PUT" ? /^\/v1\/runs\/([^/]+)$/.exec(url.pathname)?.[1] : undefined;
      const isNew = run !== undefined && !this.known.has(decodeURIComponent(run));
      this.#json(response, isNew ? 201 : 200, this.answers[url.pathname] ?? {});
    } else if ((this.read.push(url.pathname + url.search), url.pathname in this.broken)) {
      this.#json(response, 500, { title: "Internal Server Error", detail: this.broken[url.pathname] });
    } else if (url.pathname in this.files) {
      await this.slow[url.pathname];
      response.writeHead(200, { "Content-Type": "application/octet-stream" }).end(this.files[url.pathname]);
    } else if (url.pathname in this.answers) {
      this.#json(response, 200, this.answers[url.pathname]);
    } else if (url.pathname === `/v1/runs/${this.#status.run?.id}`) {
      this.#json(response, 200, { plan: { plate_map: [] } });
    } else {
      this.#live(url.pathname, request, response);
    }
  }

  #live(path: string, request: IncomingMessage, response: ServerResponse): void {
    if (/^\/v1\/runs\/[^/]+\/specimens\/\w+$/.test(path)) {
      this.#json(response, 200, kept());
      return;
    }
    if (/^\/v1\/runs\/[^/]+\/events$/.test(path)) {
      this.#json(response, 200, { events: [], next: null });
      return;
    }
    if (/^\/v1\/runs\/[^/]+\/statistics$/.test(path)) {
      this.#json(response, 200, { runs: [], modes: [], flagged: "included", specimens: 0, quantities: [] });
      return;
    }
    if (path === "/v1/bead-gates") {
      this.#json(response, 200, { gates: [] });
      return;
    }
    if (!path.startsWith("/v1/live/")) {
      this.#json(response, 404, { title: "Not Found" });
      return;
    }
    const { run, well, views } = this.shown;
    for (const [name, value] of Object.entries({ run, well, views })) response.setHeader(`Carved-${name}`, value);
    const found = this.live[path];
    if (!found) {
      response.writeHead(204).end();
      return;
    }
    const tag = `"${found.body.length}-${found.body.subarray(-64).toString("base64")}"`;
    if (request.headers["if-none-match"] === tag) {
      response.writeHead(304, { ETag: tag }).end();
      return;
    }
    response.writeHead(200, { "Content-Type": found.type, ETag: tag }).end(found.body);
  }

  #json(response: ServerResponse, code: number, body: unknown): void {
    const type = code < 400 ? "application/json" : "application/problem+json";
    response.writeHead(code, { "Content-Type": type }).end(JSON.stringify(body));
  }

  /** Until the revision is above `after`, or the wait is over. */
  async #settled(url: URL): Promise<void> {
    const after = url.searchParams.get("after");
    if (after === null || this.#status.revision > Number(after)) return;
    await new Promise<void>((resolve) => {
      const done = () => {
        clearTimeout(timer);
        this.#waiting.delete(done);
        resolve();
      };
      const timer = setTimeout(done, Number(url.searchParams.get("wait") ?? 0) * 1000);
      this.#waiting.add(done);
    });
  }
}
