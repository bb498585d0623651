// A page on the real daemon, for tests that click.

import { after, before } from "node:test";
import type { Browser, Page } from "playwright-core";
import { openBrowser, openPage } from "./browser.ts";
import { BINARY, Daemon } from "./daemon.ts";

let browser: Browser;

before(async () => {
  browser = await openBrowser();
});
after(async () => {
  await browser?.close();
});

/** What ends with a test. */
interface Ends {
  after: (end: () => Promise<unknown>) => void;
}

export const plan = (wells: object[], more: object = {}) => ({
  plate_barcode: "P-1",
  method: "standard",
  operator: "Kim",
  plate_map: wells,
  ...more,
});

export const larva = (well: string) => ({ well, specimen: "larva", dpf: 3 });

/** A page on this daemon. It ends with the test. */
export async function onPage(
  t: Ends,
  daemon: Daemon,
  context: Parameters<typeof openPage>[1] = {},
): Promise<{ page: Page; complaints: string[] }> {
  const opened = await openPage(browser, context);
  t.after(() => opened.page.context().close());
  await opened.page.goto(daemon.url);
  await opened.page.locator("#link", { hasText: /^Live$/ }).waitFor();
  return opened;
}

/** A daemon without the demo, with these arguments, and its page. Both end with the test. */
export async function opened(
  t: Ends,
  timeScale: number,
  more: readonly string[] = [],
): Promise<{ daemon: Daemon; page: Page; complaints: string[] }> {
  const daemon = await Daemon.start(BINARY, timeScale, ["--no-demo", "--small", ...more]);
  t.after(() => daemon.stop());
  return { daemon, ...(await onPage(t, daemon)) };
}

/** The identifiers of the buttons of the main part, the largest first. */
export const bySize = (page: Page) =>
  page.locator("main button:visible").evaluateAll((buttons) => {
    const area = (b: Element) => b.getBoundingClientRect().width * b.getBoundingClientRect().height;
    return buttons.sort((a, b) => area(b) - area(a)).map((b) => b.id);
  });

/** Waits until the element has this text. */
export const until = (page: Page, id: string, wanted: RegExp) =>
  page.locator(`#${id}`).filter({ hasText: wanted }).waitFor();
