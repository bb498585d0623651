// What following a run costs, in the browser and on the instrument: first paint on loopback, updates per second and how late they are drawn,
// memory of a page after each run, and the time of the instrument's steps without a page and with PAGES of them open.
//
//   node watch.mjs ../target/release/carved [PAGES] [MINUTES] [ROUNDS]     5 pages, 10 minutes, 3 rounds; a daemon of its own on the emulated rig
//   CARVED_MODEL=none node watch.mjs ...                                   the browser has no WebGL, and the processor draws no models
//
//   carved simulate ─┬─ ROUNDS times: a run alone, with readers, with pages ── moved_ms + settle_ms + grab_ms of each view
//                    └─ runs with the same pages, until MINUTES are over ───── heap and elements of the first page after each run
//
// A reader requests what a page requests in a run, and draws nothing. It stands for a page whose browser runs on another computer.
// Other work on the machine changes with time. A round shows it in all three runs.

import { spawn } from "node:child_process";
import { once } from "node:events";
import { readFileSync } from "node:fs";
import { mkdtemp, rm } from "node:fs/promises";
import { loadavg, tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const [binary = "../target/release/carved", pages = "5", minutes = "10", rounds = "3"] = process.argv.slice(2);
const URL_OF_DAEMON = "http://127.0.0.1:8429";
const WELLS = ["A01", "A02", "A03"];

const data = await mkdtemp(join(tmpdir(), "carved-watch-"));
const daemon = spawn(binary, ["simulate", "--no-demo", "--listen", "127.0.0.1:8429", "--data", data], {
  stdio: ["ignore", "pipe", "ignore"],
});
for await (const line of createInterface({ input: daemon.stdout })) if (line.includes(URL_OF_DAEMON)) break;
daemon.stdout.resume();

const read = async (path) => (await fetch(URL_OF_DAEMON + path)).json();
const share = (values, part) => [...values].sort((a, b) => a - b)[Math.floor(part * (values.length - 1))];
const two = (values) => `${share(values, 0.5).toFixed(1)}, ${share(values, 0.95).toFixed(1)}`;

/** Processor time of the daemon, s. */
function processor() {
  const HERTZ = 100;
  const fields = readFileSync(`/proc/${daemon.pid}/stat`, "utf8").split(") ")[1].split(" ");
  return (Number(fields[11]) + Number(fields[12])) / HERTZ;
}

/** Takes a run to its end. Returns the milliseconds of each step, the changes of the status per second and the daemon's processor time. */
async function run(id) {
  const wells = WELLS.map((well) => ({ well, specimen: "larva", dpf: 3 }));
  const plan = { plate_barcode: "WATCH", method: "standard", operator: "watch", plate_map: wells };
  const headers = { "content-type": "application/json" };
  const before = processor();
  const answer = await fetch(`${URL_OF_DAEMON}/v1/runs/${id}`, { method: "PUT", headers, body: JSON.stringify(plan) });
  if (!answer.ok) throw new Error(await answer.text());
  let status = await read("/v1/status");
  const [from, first] = [performance.now(), status.revision];
  while (status.run?.id !== id || status.run.outcome === null) {
    status = await read(`/v1/status?wait=5&after=${status.revision}`);
  }
  const changes = (status.revision - first) / ((performance.now() - from) / 1000);
  const processorS = processor() - before;
  const steps = [];
  for (const well of WELLS) {
    const { recording } = await read(`/v1/runs/${id}/specimens/${well}`);
    for (const { moved_ms, settle_ms, grab_ms } of recording.ledger) steps.push(moved_ms + settle_ms + grab_ms);
  }
  return { steps, changes, processorS };
}

/** Follows the instrument as a page does: each change of the status, then what has changed of frame, profile and model. */
async function follow(over) {
  const tags = new Map();
  let status = await read("/v1/status");
  let received = 0;
  while (!over.aborted) {
    const pictures = ["/v1/live/frame.jpg", "/v1/live/profile.png", "/v1/live/mesh.glb"].map(async (path) => {
      const tag = tags.get(path);
      const answer = await fetch(URL_OF_DAEMON + path, { headers: tag === undefined ? {} : { "if-none-match": tag } });
      tags.set(path, answer.headers.get("etag") ?? undefined);
      received += (await answer.arrayBuffer()).byteLength;
    });
    await Promise.all(pictures);
    status = await read(`/v1/status?wait=1&after=${status.revision}`);
  }
  return received;
}

/** Notes in the page when the status of a revision is drawn, on the clock of the computer. */
function noteDrawn() {
  const plain = window.fetch;
  window.drawn = {};
  window.fetch = async (...of) => {
    const answer = await plain(...of);
    if (answer.ok && new URL(answer.url).pathname === "/v1/status") {
      const note = ({ revision }) => (window.drawn[revision] ??= Date.now());
      // The page draws before the second frame from now.
      const drawn = (status) => requestAnimationFrame(() => requestAnimationFrame(() => note(status)));
      void answer.clone().json().then(drawn);
    }
    return answer;
  };
}

/** When each revision of the status reaches a client that draws nothing. */
async function heard(over) {
  const at = {};
  let { revision } = await read("/v1/status");
  while (!over.aborted) {
    ({ revision } = await read(`/v1/status?wait=1&after=${revision}`));
    at[revision] ??= Date.now();
  }
  return at;
}

const WEBGL =
  process.env["CARVED_MODEL"] === "none"
    ? ["--disable-gpu"]
    : ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"];

const load = () => `load ${loadavg()[0].toFixed(1)}`;
const opened = async () => {
  const browser = await chromium.launch({
    executablePath: process.env["CARVED_CHROMIUM"] ?? "/usr/bin/chromium",
    args: ["--no-sandbox", ...WEBGL],
  });
  const open = [];
  for (let i = 0; i < Number(pages); i += 1) {
    const page = await browser.newPage({ viewport: { width: 1440, height: 960 } });
    await page.addInitScript(noteDrawn);
    await page.goto(URL_OF_DAEMON);
    await page.locator("#link", { hasText: /^Live$/ }).waitFor();
    open.push(page);
  }
  const paint = () => performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? NaN;
  const paints = await Promise.all(open.map((page) => page.evaluate(paint)));
  console.log(`first paint of a page: ${two(paints)} ms (median, 95 % of ${pages}; ${load()})`);
  return { browser, open };
};

const of = { alone: [], readers: [], pages: [] };
for (let round = 1; round <= Number(rounds); round += 1) {
  const say = (who, { steps, processorS }) => {
    of[who].push(...steps);
    console.log(
      `round ${round}, ${who}: a step takes ${two(steps)} ms; the daemon used ${processorS.toFixed(1)} s of processor time (${load()})`,
    );
  };
  say("alone", await run(`alone-${round}`));
  const over = new AbortController();
  const reading = Array.from({ length: Number(pages) }, () => follow(over.signal));
  say("readers", await run(`readers-${round}`));
  over.abort();
  const received = await Promise.all(reading);
  console.log(`round ${round}: a reader received ${(share(received, 0.5) / 1e6).toFixed(1)} MB`);
  const { browser } = await opened();
  say("pages", await run(`pages-${round}`));
  await browser.close();
}
if (Number(rounds) > 0) {
  const each = Object.entries(of).map(([who, steps]) => `${two(steps)} ms ${who}`);
  console.log(`all rounds, ${pages} readers or pages: ${each.join("; ")} (median, 95 %)`);
}

const { browser, open } = await opened();
const devtools = await open[0].context().newCDPSession(open[0]);
await devtools.send("Network.enable");
await devtools.send("Performance.enable");
let updates = 0;
devtools.on("Network.responseReceived", ({ response }) => {
  if (new URL(response.url).pathname === "/v1/status") updates += 1;
});
const until = performance.now() + 60_000 * Number(minutes);
for (let i = 1; i === 1 || performance.now() < until; i += 1) {
  const from = performance.now();
  const before = updates;
  const over = new AbortController();
  const hearing = heard(over.signal);
  const { steps, changes } = await run(`watched-${i}`);
  over.abort();
  const at = await hearing;
  const drawn = Object.entries(await open[0].evaluate(() => window.drawn));
  const lags = drawn.flatMap(([revision, ms]) => (at[revision] === undefined ? [] : [Math.max(0, ms - at[revision])]));
  const seconds = (performance.now() - from) / 1000;
  await devtools.send("HeapProfiler.collectGarbage");
  const { metrics } = await devtools.send("Performance.getMetrics");
  const metric = (name) => metrics.find((one) => one.name === name).value;
  console.log(
    `${pages} pages, run ${i}: a step takes ${two(steps)} ms; ${((updates - before) / seconds).toFixed(1)} updates/s ` +
      `of ${changes.toFixed(1)} changes/s, drawn ${two(lags)} ms after a client without a page has them; ` +
      `heap ${(metric("JSHeapUsedSize") / 1e6).toFixed(1)} MB, ${metric("Nodes")} nodes, ${metric("JSEventListeners")} listeners (${load()})`,
  );
}

await browser.close();
daemon.kill("SIGTERM");
await once(daemon, "exit");
await rm(data, { recursive: true, force: true });
