/** How fluently the lobe follows the light. */

/** Turns the light with every frame for so many seconds: frames, pictures of the lobe and lobes a second; milliseconds that the
 * evaluators took for each lobe (its plane and its numbers with it), and that drawing it takes. */
export async function drag(page, seconds = 3) {
  await page.evaluate(() => window.lab.set({ theta: 50, phi: 180, view: "lobes" }));
  await page.waitForTimeout(1500);
  await page.locator("#set-theta").focus();
  return page.evaluate(async (seconds) => {
    const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
    const before = window.lab.counts();
    let frames = 0;
    const start = performance.now();
    while (performance.now() - start < 1000 * seconds) {
      await frame();
      window.lab.set({ theta: 45 + 20 * Math.sin(frames++ / 20) });
    }
    const lasted = (performance.now() - start) / 1000;
    const after = window.lab.counts();
    const pictures = [];
    for (let i = 0; i < 9; i++) {
      await frame();
      pictures.push(window.lab.picture());
    }
    return {
      frames: frames / lasted,
      drawn: (after.frames - before.frames) / lasted,
      updates: (after.updates - before.updates) / lasted,
      evaluator: (after.ms - before.ms) / Math.max(1, after.updates - before.updates),
      picture: pictures.sort((a, b) => a - b)[4],
    };
  }, seconds);
}
