// What axe finds on a page, at every width and in both themes.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import type { Page } from "playwright-core";

const axe = await readFile(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

/** Widths of a wall, a desk, a tablet and a telephone, px. */
export const WIDTHS = [3840, 1440, 768, 390] as const;

/** Breaches that axe finds, one line each. */
export async function breaches(page: Page): Promise<string[]> {
  // The policy of a page permits no script from elsewhere. This one runs outside of it.
  return page.evaluate(async (source) => {
    const module = { exports: {} as { run: (d: Document) => Promise<{ violations: Violation[] }> } };
    type Violation = { id: string; help: string; nodes: { target: string[]; failureSummary?: string }[] };
    new Function("module", "exports", source)(module, module.exports);
    const { violations } = await module.exports.run(document);
    return violations.flatMap((v) =>
      v.nodes.map((n) => `${v.id}: ${v.help}: ${n.target.join(" ")} ${n.failureSummary}`),
    );
  }, axe);
}

/** The screen fits each width and axe finds nothing, in both themes. `also` looks at each of them. Ends narrow. */
export async function isAccessible(page: Page, name: string, also: (of: string) => Promise<void> = async () => {}) {
  for (const theme of ["light", "dark"] as const) {
    await page.emulateMedia({ colorScheme: theme });
    for (const width of WIDTHS) {
      await page.setViewportSize({ width, height: 1000 });
      const of = `${name}, ${theme}, ${width} px`;
      const { scheme, beyond, wide } = await page.evaluate(() => ({
        scheme: getComputedStyle(document.documentElement).colorScheme,
        beyond: document.documentElement.scrollWidth - innerWidth,
        wide: [...document.querySelectorAll("*")]
          .filter((e) => e.getBoundingClientRect().right > innerWidth + 1)
          .map((e) => `${e.tagName}#${e.id}.${e.className}`),
      }));
      assert.equal(scheme, theme, of);
      assert.ok(beyond <= 0, `${of}: ${beyond} px beyond the right edge: ${wide.join(" ")}`);
      await also(of);
      assert.deepEqual(await breaches(page), [], of);
    }
  }
}
