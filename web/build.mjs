// Bundles the page into dist/ (three files that the daemon embeds, plain and compressed), or with --tests the tests into build/.

import { build } from "esbuild";
import { copyFile, mkdir, readdir, readFile, rm, stat, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";

/** Small and without a trace of the machine it was built on: the same sources give the same bytes. */
async function page() {
  await rm("dist", { recursive: true, force: true });
  await mkdir("dist", { recursive: true });
  await build({
    entryPoints: { app: "src/main.ts" },
    outdir: "dist",
    bundle: true,
    minify: true,
    format: "esm",
    target: ["chrome109", "firefox115", "safari16.4"],
    legalComments: "eof",
    logLevel: "warning",
  });
  await build({
    entryPoints: { app: "src/app.css" },
    outdir: "dist",
    bundle: true,
    minify: true,
    target: ["chrome109", "firefox115", "safari16.4"],
    logLevel: "warning",
  });
  await copyFile("src/index.html", "dist/index.html");
  for (const name of await readdir("dist")) await compress(join("dist", name));
  for (const name of await readdir("dist")) {
    const { size } = await stat(join("dist", name));
    console.log(`web/dist/${name}  ${(size / 1024).toFixed(1)} KiB`);
  }
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

await (process.argv.includes("--tests") ? tests() : page());
