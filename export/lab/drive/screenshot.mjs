/**
 * A picture of the built lab: node drive/screenshot.mjs out.png [--hash "#view=energy"] [--size 1440x900] [--dark]
 * [--phone] [--wait seconds] [--folder ../../build/lab]
 */

import { parseArgs } from "node:util";
import { executable, open, serve } from "./browser.mjs";

const { values, positionals } = parseArgs({
  allowPositionals: true,
  options: {
    hash: { type: "string", default: "" },
    size: { type: "string", default: "1440x900" },
    wait: { type: "string", default: "60" },
    folder: { type: "string", default: new URL("../../../build/lab", import.meta.url).pathname },
    dark: { type: "boolean", default: false },
    phone: { type: "boolean", default: false },
    whole: { type: "boolean", default: false },
  },
});
if (!executable()) {
  console.error("There is no Chromium here: apt-get install chromium, or name one in $CHROMIUM.");
  process.exit(2);
}
const [width, height] = (values.phone ? "390x844" : values.size).split("x").map(Number);
const server = await serve(values.folder);
const { page, seen, close } = await open({
  viewport: { width, height },
  deviceScaleFactor: values.phone ? 2 : 1.25,
  hasTouch: values.phone,
  isMobile: values.phone,
  colorScheme: values.dark ? "dark" : "light",
});
try {
  const start = Date.now();
  await page.goto(server.url + values.hash);
  await page.waitForFunction(() => window.lab);
  console.log(`loaded after ${Date.now() - start} ms`);
  // Until the numbers stand still, and a little longer for the pictures.
  const settled = () => window.lab.state().view !== "lobes" || window.lab.numbers() !== null;
  await page
    .waitForFunction(settled, null, { timeout: 1000 * Number(values.wait) })
    .catch(() => console.log("not settled"));
  await page.waitForTimeout(values.hash.includes("view=") ? 1000 * Number(values.wait) : 2500);
  await page.screenshot({ path: positionals[0] ?? "lab.png", fullPage: values.whole });
  console.log(seen.errors.concat(seen.foreign).join("\n") || "no errors");
} finally {
  await close();
  server.close();
}
