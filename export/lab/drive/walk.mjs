/**
 * Walks through the built lab with a mouse, the keyboard and a finger: node drive/walk.mjs URL [folder for pictures]
 *
 * Prints as JSON, by hand and control, whether each did what it is for; see tests/onnx/test_lab_hands.py.
 */

import { join } from "node:path";
import { open } from "./browser.mjs";

const [url, pictures] = process.argv.slice(2);
const VIEWS = ["energy", "surface", "graphs", "lobes"];
const changed = (a, b) => JSON.stringify(a) !== JSON.stringify(b);

/** A page, and what both hands do on it; `drag` is theirs. */
function walker(page, drag) {
  const lab = (name) => page.evaluate((name) => window.lab[name](), name);
  const set = (change) => page.evaluate((change) => window.lab.set(change), change);
  const box = (selector) => page.locator(selector).boundingBox();
  const still = () => page.evaluate(() => new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r))));
  /** Whether dragging from one place to another changes what `read` reads. */
  const moves = async (from, by, read) => {
    const before = await read();
    await drag(from, [from[0] + by[0], from[1] + by[1]]);
    await still();
    return changed(before, await read());
  };
  const state =
    (...keys) =>
    async () => {
      const now = await lab("state");
      return keys.map((key) => now[key]);
    };
  const handles = () => lab("handles");
  /** The handles, the camera and the line between one bounce and all. */
  const directly = async () => {
    const used = {};
    await set({ view: "lobes", theta: 50, phi: 180, outTheta: 50, outPhi: 0 });
    await page.locator("#stage").scrollIntoViewIfNeeded();
    await still();
    used.light = await moves((await handles())[0], [30, -12], state("theta", "phi"));
    used.exit = await moves((await handles())[1], [-30, -12], state("outTheta", "outPhi"));
    const directions = state("theta", "phi", "outTheta", "outPhi");
    const before = await directions();
    const stage = await box("#stage");
    used.camera = await moves([stage.x + 30, stage.y + stage.height - 60], [60, 0], handles);
    used["camera alone"] = !changed(before, await directions());
    await set({ view: "energy" });
    await page.locator("#sphere-0").scrollIntoViewIfNeeded();
    const sphere = await box("#sphere-0");
    used.split = await moves([sphere.x + sphere.width / 2, sphere.y + sphere.height / 2], [40, 0], state("split"));
    await set({ view: "lobes" });
    return used;
  };
  /** Whether a press downloads a file of some size, in every view. */
  const downloads = async (press) => {
    const used = {};
    for (const view of VIEWS) {
      await set({ view });
      await page.waitForTimeout(view === "lobes" ? 500 : 4000);
      for (const id of ["save-picture", "save-numbers"]) {
        const [file] = await Promise.all([page.waitForEvent("download"), press(`#${id}`)]);
        const stream = await file.createReadStream();
        let size = 0;
        for await (const part of stream) size += part.length;
        used[`${id} ${view}`] = size > 200;
      }
    }
    return used;
  };
  /** Nothing reaches beyond the screen's edge; a picture of each view. */
  const views = async (name) => {
    const used = {};
    for (const view of VIEWS) {
      await set({ view });
      await page.waitForTimeout(pictures ? 5000 : 500);
      used[`${view} fits`] = await page.evaluate(() => document.documentElement.scrollWidth <= window.innerWidth);
      if (pictures) await page.screenshot({ path: join(pictures, `${name}-${view}.png`), fullPage: true });
    }
    return used;
  };
  return { page, set, state, handles, still, moves, directly, downloads, views, box };
}

async function ready(options) {
  const opened = await open({ acceptDownloads: true, ...options });
  opened.page.setDefaultTimeout(120_000);
  await opened.page.goto(url);
  await opened.page.waitForFunction(() => window.lab?.numbers() != null);
  return opened;
}

async function mouse(page) {
  const walk = walker(page, async (from, to) => {
    await page.mouse.move(...from);
    await page.mouse.down();
    await page.mouse.move((from[0] + to[0]) / 2, (from[1] + to[1]) / 2);
    await page.mouse.move(...to);
    await page.mouse.up();
  });
  const used = { ...(await walk.directly()) };
  const stage = await walk.box("#stage");
  const before = await walk.handles();
  await page.mouse.move(stage.x + 30, stage.y + stage.height - 60);
  await page.mouse.wheel(0, 240);
  await walk.still();
  used.zoom = changed(before, await walk.handles());
  const slider = await walk.box("#set-alpha");
  const middle = slider.y + slider.height / 2;
  used.slider = await walk.moves([slider.x + slider.width / 2, middle], [50, 0], walk.state("alpha"));
  await page.locator("#model-turquin").click();
  used.model = (await walk.state("models")())[0].includes("turquin");
  return { ...used, ...(await walk.downloads((id) => page.locator(id).click())), ...(await walk.views("light")) };
}

async function keyboard(page) {
  const walk = walker(page, null);
  await walk.set({ view: "lobes", theta: 50, phi: 170, outTheta: 50, outPhi: 0 });
  const presses = async (focus, key, read) => {
    const before = await read();
    await page.locator(focus).focus();
    await page.keyboard.press(key);
    await walk.still();
    return changed(before, await read());
  };
  const used = {
    light: await presses("#stage", "ArrowUp", walk.state("theta")),
    around: await presses("#stage", "ArrowLeft", walk.state("phi")),
    exit: await presses("#stage", "Shift+ArrowUp", walk.state("outTheta")),
    camera: await presses("#stage", "a", walk.handles),
    zoom: await presses("#stage", "+", walk.handles),
    slider: await presses("#set-alpha", "ArrowRight", walk.state("alpha")),
    material: await presses("#material-conductor", "ArrowRight", walk.state("material")),
    box: await presses("#set-round", "Space", walk.state("round")),
    view: await presses("#view-lobes", "ArrowRight", walk.state("view")),
    split: await presses("#set-split", "ArrowRight", walk.state("split")),
  };
  // Every control is reached by Tab, and is named.
  const reached = await page.evaluate(() => {
    const seen = [...document.querySelectorAll("button, input, select, canvas[tabindex]")].filter(
      (e) => e.offsetParent,
    );
    const named = (e) => e.labels?.length || e.textContent.trim() || e.getAttribute("aria-label");
    return seen.every((e) => e.tabIndex >= 0 && named(e));
  });
  await walk.set({ view: "lobes", material: "conductor", round: true });
  return { ...used, reached };
}

/** Files that are dropped: a good one is drawn, a foreign one gets a sentence. */
async function drops(page) {
  const drop = (name, path) =>
    page.evaluate(
      async ([name, path]) => {
        const bytes = path ? await (await fetch(path)).arrayBuffer() : new TextEncoder().encode("no network");
        const carried = new DataTransfer();
        carried.items.add(new File([bytes], name));
        window.dispatchEvent(new DragEvent("drop", { dataTransfer: carried, bubbles: true, cancelable: true }));
      },
      [name, path],
    );
  await drop("letter.onnx", "");
  await page.locator(".notice").waitFor({ state: "visible" });
  const sentence = await page.locator(".notice span").textContent();
  await page.locator(".notice button").click();
  await drop("mine.onnx", "models/conductor-ggx-distilled.onnx");
  await page.waitForFunction(() => window.lab.state().model === "dropped:mine" && window.lab.numbers() !== null);
  return { foreign: /was not written by torchms/.test(sentence), mine: true };
}

async function touch(page) {
  const client = await page.context().newCDPSession(page);
  const send = (type, point) =>
    client.send("Input.dispatchTouchEvent", { type, touchPoints: point ? [{ x: point[0], y: point[1] }] : [] });
  const walk = walker(page, async (from, to) => {
    await send("touchStart", from);
    for (let i = 1; i <= 6; i++)
      await send(
        "touchMove",
        [0, 1].map((c) => from[c] + ((to[c] - from[c]) * i) / 6),
      );
    await send("touchEnd");
  });
  const used = { ...(await walk.directly()) };
  for (const view of VIEWS) {
    await page.locator(`[id="view-${view}"]`).tap();
    used[`tab ${view}`] = (await walk.state("view")())[0] === view;
  }
  await page.locator("button.sheet").tap();
  await page.waitForTimeout(400);
  await page.locator("#material-dielectric").tap();
  used.material = (await walk.state("material")())[0] === "dielectric";
  const slider = await walk.box("#set-alpha");
  const middle = slider.y + slider.height / 2;
  const at = slider.x + 0.63 * slider.width;
  used.slider = await walk.moves([at, middle], [60, 0], walk.state("alpha"));
  if (pictures) await page.screenshot({ path: join(pictures, "phone-sheet.png") });
  await page.locator("button.sheet").tap();
  await page.waitForTimeout(400);
  await walk.set({ material: "conductor" });
  return { ...used, ...(await walk.downloads((id) => page.locator(id).tap())), ...(await walk.views("phone")) };
}

const found = {};
const desk = await ready({ viewport: { width: 1440, height: 1000 } });
try {
  found.mouse = await mouse(desk.page);
  found.keyboard = await keyboard(desk.page);
  found.dropped = await drops(desk.page);
  if (pictures) {
    await desk.page.evaluate(() => window.lab.set({ theme: "dark", model: "distilled", material: "dielectric" }));
    await walker(desk.page, null).views("dark");
  }
} finally {
  await desk.close();
}
const phone = await ready({
  viewport: { width: 390, height: 844 },
  deviceScaleFactor: 2,
  hasTouch: true,
  isMobile: true,
});
try {
  found.touch = await touch(phone.page);
} finally {
  await phone.close();
}
found.errors = [...desk.seen.errors, ...phone.seen.errors];
console.log(JSON.stringify(found));
