// Bundles the operator's page into dist/ and the page of `carved setup` into dist/setup/ (compressed; the program embeds them), and renders the documentation into dist/docs/; or with --tests the tests into build/.

import { build } from "esbuild";
import { copyFile, mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";
import { docs } from "./docs.mjs";

/** What both pages have in common. */
const COMMON = {
  bundle: true,
  minify: true,
  target: ["chrome109", "firefox115", "safari16.4"],
  logLevel: "warning",
};

/** Builds one page: HTML, style and script, compressed. What the script imports later is a file of its own. The same sources give the same bytes on every machine. */
async function page(html, script, style, outdir) {
  await mkdir(outdir, { recursive: true });
  const later = { splitting: true, chunkNames: "[name]" };
  await build({ ...COMMON, ...later, entryPoints: script, outdir, format: "esm", legalComments: "eof" });
  await build({ ...COMMON, entryPoints: style, outdir });
  await copyFile(html, join(outdir, "index.html"));
  const files = (await readdir(outdir, { withFileTypes: true })).filter((entry) => entry.isFile());
  for (const { name } of files) {
    const size = await compress(join(outdir, name));
    console.log(`web/${outdir}/${name}  ${(size / 1024).toFixed(1)} KiB`);
  }
}

async function pages() {
  await rm("dist", { recursive: true, force: true });
  await page("src/setup/index.html", { setup: "src/setup/main.ts" }, { setup: "src/setup/setup.css" }, "dist/setup");
  await page("src/wall/index.html", { wall: "src/wall/main.ts" }, { wall: "src/wall/wall.css" }, "dist/wall");
  const count = await docs("..", "dist/docs");
  await build({ ...COMMON, entryPoints: { docs: "src/docs/main.ts" }, outdir: "dist/docs", format: "esm" });
  await build({ ...COMMON, entryPoints: { docs: "src/docs/docs.css" }, outdir: "dist/docs" });
  console.log(`web/dist/docs  ${count} pages`);
  // Last: make takes this file's time for that of the whole folder.
  await page("src/index.html", { app: "src/main.ts" }, { app: "src/app.css" }, "dist");
}

/**
 * Replaces a file by `FILE.br` and `FILE.gz`. The daemon sends them to browsers that read them, and unpacks `FILE.gz` for other clients.
 * Returns the size of the file in bytes. gzip does not store the time of the build.
 */
async function compress(file) {
  const whole = await readFile(file);
  const quality = { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_SIZE_HINT]: whole.length };
  await writeFile(`${file}.br`, brotliCompressSync(whole, { params: quality }));
  await writeFile(`${file}.gz`, gzipSync(whole, { level: 9 }));
  await rm(file);
  return whole.length;
}

/** Node 18 does not strip types by itself, so the tests are bundled as well; packages stay outside. */
async function tests() {
  await rm("build", { recursive: true, force: true });
  const found = [];
  for (const kind of ["unit", "browser"]) {
    for (const name of await readdir(join("test", kind))) {
      if (name.endsWith(".test.ts")) found.push(join("test", kind, name));
    }
  }
  await build({
    entryPoints: found,
    outbase: ".",
    outdir: "build",
    outExtension: { ".js": ".mjs" },
    bundle: true,
    platform: "node",
    format: "esm",
    target: "node18",
    packages: "external",
    sourcemap: "inline",
    logLevel: "warning",
  });
}

await (process.argv.includes("--tests") ? tests() : pages());
