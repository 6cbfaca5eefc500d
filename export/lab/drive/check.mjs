/**
 * Uses the lab as a visitor would, and prints what was seen as JSON: node drive/check.mjs URL plan.json
 *
 * The plan holds `states` whose numbers are wanted, and `files` that are opened; see tests/onnx/test_lab.py.
 */

import { readFile } from "node:fs/promises";
import { open } from "./browser.mjs";
import { drag } from "./drag.mjs";

const [url, planPath] = process.argv.slice(2);
const plan = JSON.parse(await readFile(planPath, "utf8"));

/** Numbers with all digits, and as the table shows them, once they stand still. */
async function numbers(page, state) {
  await page.evaluate((change) => window.lab.set(change), state);
  const complaint = () => document.querySelector(".notice:not([hidden]) span")?.textContent ?? "";
  const settled = page.waitForFunction(
    () => window.lab.numbers() !== null || document.querySelector(".notice:not([hidden])"),
  );
  await settled.catch((error) => {
    throw new Error(`${error.message}: ${JSON.stringify(state)}`);
  });
  const said = await page.evaluate(complaint);
  if (said) throw new Error(`${said} ${JSON.stringify(state)}`);
  return page.evaluate(() => ({
    ...window.lab.numbers(),
    shown: [...document.querySelectorAll("#numbers tbody tr")].map((row) =>
      [...row.cells].map((cell) => cell.textContent),
    ),
    state: window.lab.state(),
  }));
}

/** The sentence that a file gets. */
async function sentence(page, path) {
  await page.locator("#open-file").setInputFiles(path);
  const alert = page.locator(".notice");
  await alert.waitFor({ state: "visible", timeout: 20_000 });
  const text = await alert.locator("span").textContent();
  await alert.getByRole("button").click();
  return text;
}

/** Every control is used once: what it changed in the state. */
async function controls(page) {
  const used = {};
  const start = {
    round: true,
    alpha: 0.6,
    theta: 50,
    phi: 100,
    outTheta: 40,
    outPhi: 20,
    bounce: "all",
    theme: "light",
  };
  await page.evaluate((change) => window.lab.set(change), start);
  const state = () => page.evaluate(() => window.lab.state());
  for (const view of ["energy", "surface", "graphs", "lobes"]) {
    await page.locator(`[id="view-${view}"]`).click();
    used[`view ${view}`] = (await state()).view;
  }
  for (const [id, key] of [
    ["material-dielectric", "material"],
    ["material-diffuse", "material"],
    ["material-conductor", "material"],
    ["bounce-2+", "bounce"],
    ["bounce-all", "bounce"],
    ["scale-log", "scale"],
    ["tint-colour", "tint"],
    ["channel-R", "channel"],
    ["theme-dark", "theme"],
  ]) {
    await page.locator(`[id="${id}"]`).click();
    used[id] = (await state())[key];
  }
  await page.locator("#set-round").click();
  used.round = (await state()).round;
  for (const key of ["alpha", "alphaY", "theta", "phi", "outTheta", "outPhi"]) {
    const before = (await state())[key];
    await page.locator(`#set-${key}`).focus();
    await page.keyboard.press("ArrowLeft");
    used[key] = (await state())[key] !== before;
  }
  await page.locator("#set-metal").selectOption("Cu");
  used.metal = (await state()).metal;
  await page.locator("#stage").focus();
  const theta = (await state()).theta;
  await page.keyboard.press("ArrowUp");
  used.arrow = (await state()).theta - theta;
  return used;
}

const { page, seen, close } = await open({ viewport: { width: 1440, height: 1000 }, acceptDownloads: true });
// A busy machine is slow, not wrong.
page.setDefaultTimeout(120_000);
try {
  const start = Date.now();
  await page.goto(url);
  await page.waitForFunction(() => window.lab);
  const found = { loaded: Date.now() - start };
  found.first = await numbers(page, {});
  found.settled = Date.now() - start;
  found.numbers = [];
  for (const state of plan.states ?? []) found.numbers.push(await numbers(page, state));
  found.drag = await drag(page);
  found.sentences = [];
  for (const file of plan.refused ?? []) found.sentences.push(await sentence(page, file));
  if (plan.taken) {
    await page.locator("#open-file").setInputFiles(plan.taken);
    await page.waitForFunction(() => window.lab.state().model.startsWith("dropped:"));
    found.taken = await numbers(page, {});
  }
  found.controls = await controls(page);
  const [csv] = await Promise.all([page.waitForEvent("download"), page.locator("#save-numbers").click()]);
  found.csv = await readFile(await csv.path(), "utf8");
  const [png] = await Promise.all([page.waitForEvent("download"), page.locator("#save-picture").click()]);
  found.png = [...(await readFile(await png.path())).subarray(0, 8)];
  await page.waitForTimeout(600);
  found.address = await page.evaluate(() => location.hash);
  console.log(JSON.stringify({ ...found, ...seen }));
} finally {
  await close();
}
