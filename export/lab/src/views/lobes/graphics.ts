/** What draws the stage: a graphics processor, or in its place the browser's own arithmetic. */

/** Pixels of the picture along a pixel of the page, while something moves and at rest. */
export interface Quality {
  moving: number;
  resting: number;
}

/** A processor smooths the edges of every picture; without one, that is left to a picture of four times the size at rest. */
export function graphics(canvas: HTMLCanvasElement): { context: WebGL2RenderingContext; quality: Quality } {
  const screen = Math.min(window.devicePixelRatio, 2);
  const wanted: WebGLContextAttributes = { alpha: true, antialias: true, failIfMajorPerformanceCaveat: true };
  const fast = canvas.getContext("webgl2", wanted);
  if (fast) return { context: fast, quality: { moving: screen, resting: screen } };
  const slow = canvas.getContext("webgl2", { alpha: true, antialias: false });
  if (!slow) throw new Error("this browser draws nothing in 3-D (WebGL 2 is missing or switched off)");
  return { context: slow, quality: { moving: 0.75, resting: 2 } };
}
