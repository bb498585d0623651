// Bundles the operator's page into dist/ and the page of `carved setup` into dist/setup/ (three files each, which the program embeds,
// plain and compressed), and renders the documentation into dist/docs/; or with --tests the tests into build/.

import { build } from "esbuild";
import { copyFile, mkdir, readdir, readFile, rm, stat, writeFile } from "node:fs/promises";
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

/** Builds one page: three files, plain and compressed. The same sources give the same bytes on every machine. */
async function page(html, script, style, outdir) {
  await mkdir(outdir, { recursive: true });
  await build({ ...COMMON, entryPoints: script, outdir, format: "esm", legalComments: "eof" });
  await build({ ...COMMON, entryPoints: style, outdir });
  await copyFile(html, join(outdir, "index.html"));
  const files = (await readdir(outdir, { withFileTypes: true })).filter((entry) => entry.isFile());
  for (const { name } of files) {
    await compress(join(outdir, name));
    const { size } = await stat(join(outdir, name));
    console.log(`web/${outdir}/${name}  ${(size / 1024).toFixed(1)} KiB`);
  }
}

async function pages() {
  await rm("dist", { recursive: true, force: true });
  await page("src/setup/index.html", { setup: "src/setup/main.ts" }, { setup: "src/setup/setup.css" }, "dist/setup");
  const count = await docs("..", "dist/docs");
  await build({ ...COMMON, entryPoints: { docs: "src/docs/main.ts" }, outdir: "dist/docs", format: "esm" });
  await build({ ...COMMON, entryPoints: { docs: "src/docs/docs.css" }, outdir: "dist/docs" });
  console.log(`web/dist/docs  ${count} pages`);
  // Last: make takes this file's time for that of the whole folder.
  await page("src/index.html", { app: "src/main.ts" }, { app: "src/app.css" }, "dist");
}

/** Writes `FILE.br` and `FILE.gz`, which the daemon sends to browsers that read them. gzip without the time of the build. */
async function compress(file) {
  const whole = await readFile(file);
  const quality = { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_SIZE_HINT]: whole.length };
  await writeFile(`${file}.br`, brotliCompressSync(whole, { params: quality }));
  await writeFile(`${file}.gz`, gzipSync(whole, { level: 9 }));
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
