/** How fluently the lobe follows the light. */

/** Turns the light with every frame for three seconds: frames, pictures of the lobe and answers of the evaluator a second. */
export async function drag(page) {
  await page.evaluate(() => window.lab.set({ theta: 50, phi: 180, view: "lobes" }));
  await page.waitForTimeout(1500);
  await page.locator("#set-theta").focus();
  return page.evaluate(async () => {
    const before = window.lab.counts();
    let frames = 0;
    const start = performance.now();
    while (performance.now() - start < 3000) {
      await new Promise((resolve) => requestAnimationFrame(resolve));
      window.lab.set({ theta: 45 + 20 * Math.sin(frames++ / 20) });
    }
    const seconds = (performance.now() - start) / 1000;
    const after = window.lab.counts();
    return {
      frames: frames / seconds,
      drawn: (after.frames - before.frames) / seconds,
      updates: (after.updates - before.updates) / seconds,
    };
  });
}
