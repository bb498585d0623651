// Debian's Chromium, headless, with a software WebGL; a page that fails its test when it complains.

import { chromium, type Browser, type Locator, type Page } from "playwright-core";
import { mkdir } from "node:fs/promises";
import { join } from "node:path";

export async function openBrowser(): Promise<Browser> {
  return chromium.launch({
    executablePath: process.env["CARVED_CHROMIUM"] ?? "/usr/bin/chromium",
    args: [
      "--no-sandbox",
      "--disable-quic",
      "--no-first-run",
      "--disable-background-networking",
      "--disable-component-update",
      "--disable-sync",
      "--use-angle=swiftshader",
      "--enable-unsafe-swiftshader",
    ],
  });
}

/** A fresh page; `complaints` fills with script errors and breaches of the content security policy. */
export async function openPage(
  browser: Browser,
  { width = 1440, height = 960, hasTouch = false } = {},
): Promise<{ page: Page; complaints: string[] }> {
  const context = await browser.newContext({ viewport: { width, height }, hasTouch });
  // A busy machine that draws in software needs longer than the usual 30 s.
  context.setDefaultTimeout(90_000);
  const page = await context.newPage();
  const complaints: string[] = [];
  page.on("pageerror", (error) => complaints.push(String(error)));
  page.on("console", (message) => {
    const text = message.text();
    // A daemon that is away, and one that refuses what was asked, are no errors of the page; something that is not there is.
    const isAnswer = /^Failed to load resource/.test(text) && !/404/.test(text);
    if (message.type() === "error" && !isAnswer) complaints.push(`${text} ${message.location().url}`);
    // Chromium says when a GPU feature is emulated; three.js would say when its use is wrong.
    else if (message.type() === "warning" && !/GPU stall|GL Driver Message/.test(text)) complaints.push(text);
  });
  return { page, complaints };
}

/** Writes a screenshot where CARVED_SCREENSHOTS asks for them. */
export async function shoot(page: Page, name: string): Promise<void> {
  const folder = process.env["CARVED_SCREENSHOTS"];
  if (!folder) return;
  await mkdir(folder, { recursive: true });
  // At the top, where the head of the page is over nothing.
  await page.evaluate(() => scrollTo(0, 0));
  await page.screenshot({ path: join(folder, `${name}.png`), fullPage: true });
}

/** The pixels of an element that differ clearly from its corner's: their colours and columns, and how many pixels there are. */
async function different(
  element: Locator,
): Promise<{ columns: number[]; colours: number[]; width: number; all: number }> {
  const data = (await element.screenshot()).toString("base64");
  return element.page().evaluate(async (base64) => {
    const image = new Image();
    image.src = `data:image/png;base64,${base64}`;
    await image.decode();
    const canvas = document.createElement("canvas");
    const width = (canvas.width = image.naturalWidth);
    canvas.height = image.naturalHeight;
    const context = canvas.getContext("2d")!;
    context.drawImage(image, 0, 0);
    const { data: pixels } = context.getImageData(0, 0, canvas.width, canvas.height);
    const [columns, colours]: number[][] = [[], []];
    for (let i = 0; i < pixels.length; i += 4) {
      const far = [0, 1, 2].some((c) => Math.abs(pixels[i + c]! - pixels[c]!) > 24);
      if (!far) continue;
      columns!.push((i / 4) % width);
      colours!.push((pixels[i]! << 16) | (pixels[i + 1]! << 8) | pixels[i + 2]!);
    }
    return { columns: columns!, colours: colours!, width, all: pixels.length / 4 };
  }, data);
}

/** Share of an element's pixels that differ clearly from its corner's, and how many shades they have. */
export async function drawn(element: Locator): Promise<{ share: number; shades: number }> {
  const { colours, all } = await different(element);
  return { share: colours.length / all, shades: new Set(colours).size };
}

/** Share of what is drawn that is in the right half. */
export async function rightShare(element: Locator): Promise<number> {
  const { columns, width } = await different(element);
  return columns.filter((column) => column > width / 2).length / columns.length;
}
