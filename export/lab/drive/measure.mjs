/**
 * All that docs/lab.md says of how quick and how large the built lab is: node drive/measure.mjs [folder]
 *
 * Milliseconds until its controls answer, the first lobe is drawn and the first numbers stand still, the best of three empty
 * profiles; then what drag.mjs counts, for metal and for glass, with Distilled; and the sizes of the files. Under two minutes.
 */

import { readdir, stat } from "node:fs/promises";
import { loadavg } from "node:os";
import { join } from "node:path";
import { open, serve } from "./browser.mjs";
import { drag } from "./drag.mjs";

const folder = process.argv[2] ?? new URL("../../../build/lab", import.meta.url).pathname;
const server = await serve(folder);
const found = { load: loadavg()[0], loaded: Infinity, drawn: Infinity, settled: Infinity };
for (let turn = 0; turn < 3; turn++) {
  const { page, close } = await open({ viewport: { width: 1440, height: 1000 } });
  const start = Date.now();
  const until = async (name, reached) => {
    await page.waitForFunction(reached, null, { timeout: 30_000 });
    found[name] = Math.min(found[name], Date.now() - start);
  };
  await page.goto(server.url);
  await until("loaded", () => window.lab);
  await until("drawn", () => window.lab.counts().updates > 0);
  await until("settled", () => window.lab.numbers() !== null);
  if (turn === 2) {
    found.metal = await drag(page, 5);
    await page.evaluate(() => window.lab.set({ material: "dielectric" }));
    await page.waitForFunction(() => window.lab.numbers() !== null);
    found.glass = await drag(page, 5);
  }
  await close();
}
server.close();

const files = await readdir(folder, { recursive: true, withFileTypes: true });
const sizes = { runtime: 0, evaluators: 0, others: 0 };
for (const file of files.filter((each) => each.isFile())) {
  const kind = file.name.endsWith(".wasm") ? "runtime" : file.name.endsWith(".onnx") ? "evaluators" : "others";
  sizes[kind] += (await stat(join(file.parentPath, file.name))).size;
}
const rounded = (_, value) => (typeof value === "number" ? Number(value.toPrecision(3)) : value);
console.log(JSON.stringify({ ...found, megabytes: scaled(sizes) }, rounded, 1));

function scaled(bytes) {
  return Object.fromEntries(Object.entries(bytes).map(([name, size]) => [name, size / 1e6]));
}
