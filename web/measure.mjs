// What the page costs on a slow machine: bytes and time until it shows the status, bytes and time of a stored well, work per second while
// it follows a run. Chromium is slowed down: a processor at a quarter of its speed, a network of 10 Mbit/s with 20 ms.
//
//   node measure.mjs http://127.0.0.1:8420 [WELL]      a daemon whose run has stored WELL (A01)

import { chromium } from "playwright-core";

const [url = "http://127.0.0.1:8420", well = "A01"] = process.argv.slice(2);
const SECONDS = 10;

const browser = await chromium.launch({
  executablePath: process.env["CARVED_CHROMIUM"] ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});
const page = await browser.newPage({ viewport: { width: 1440, height: 960 } });
const devtools = await page.context().newCDPSession(page);
await devtools.send("Network.enable");
await devtools.send("Performance.enable");
await devtools.send("Network.emulateNetworkConditions", {
  ...{ offline: false, latency: 20, downloadThroughput: 1.25e6, uploadThroughput: 1.25e6 },
});
await devtools.send("Emulation.setCPUThrottlingRate", { rate: 4 });
let bytes = 0;
let requests = 0;
devtools.on("Network.loadingFinished", ({ encodedDataLength }) => {
  bytes += encodedDataLength;
  requests += 1;
});

const kB = (count) => `${(count / 1000).toFixed(0)} kB`;
const metrics = async () => {
  const { metrics: all } = await devtools.send("Performance.getMetrics");
  return Object.fromEntries(all.map(({ name, value }) => [name, value]));
};

let from = performance.now();
await page.goto(url);
await page.locator("#link", { hasText: /^Live$/ }).waitFor();
const live = performance.now() - from;
const paint = await page.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? NaN);
console.log(
  `first paint after ${paint.toFixed(0)} ms; status on the page after ${live.toFixed(0)} ms and ${kB(bytes)}`,
);

const known = bytes;
from = performance.now();
await page.locator(`button[data-well="${well}"]`).click();
await page.locator("#frame-whose", { hasText: /^view 1 of \d+$/ }).waitFor();
console.log(`a stored well: its first view after ${(performance.now() - from).toFixed(0)} ms`);
const strip = page.locator("#views-list img");
if ((await strip.count()) > 0) {
  await page.locator("#views").scrollIntoViewIfNeeded();
  await page.waitForFunction(() => [...document.querySelectorAll("#views-list img")].every((i) => i.naturalWidth > 0));
  console.log(`all its views with outlines after ${(performance.now() - from).toFixed(0)} ms`);
}
console.log(`${kB(bytes - known)} for it`);
const one = bytes;
from = performance.now();
await page.locator("#frame-view").focus();
await page.keyboard.press("ArrowRight");
await page.locator("#frame-whose", { hasText: /^view 2 of \d+$/ }).waitFor();
console.log(`the next view after ${(performance.now() - from).toFixed(0)} ms and ${kB(bytes - one)}`);

// Everything is on the page: what remains is the work of following the status.
const before = await metrics();
const polls = requests;
await new Promise((resolve) => setTimeout(resolve, SECONDS * 1000));
const after = await metrics();
const busy = (100 * (after.TaskDuration - before.TaskDuration)) / SECONDS;
console.log(
  `${((requests - polls) / SECONDS).toFixed(1)} requests per s; the page works ${busy.toFixed(0)} % of the time`,
);

await browser.close();
