/**
 * How soon the built lab is there, and how fluently it follows: node drive/measure.mjs [folder]
 *
 * Milliseconds until its controls answer and until the first numbers stand still, the best of three empty profiles; then what
 * drag.mjs counts.
 */

import { open, serve } from "./browser.mjs";
import { drag } from "./drag.mjs";

const server = await serve(process.argv[2] ?? new URL("../../../build/lab", import.meta.url).pathname);
const best = { loaded: Infinity, settled: Infinity };
for (let turn = 0; turn < 3; turn++) {
  const { page, close } = await open({ viewport: { width: 1440, height: 1000 } });
  const start = Date.now();
  await page.goto(server.url);
  await page.waitForFunction(() => window.lab);
  best.loaded = Math.min(best.loaded, Date.now() - start);
  await page.waitForFunction(() => window.lab.numbers() !== null);
  best.settled = Math.min(best.settled, Date.now() - start);
  if (turn === 2) Object.assign(best, await drag(page));
  await close();
}
server.close();
console.log(JSON.stringify(best));
