/** Fields of colour: a grid of numbers as a picture that scales without blur. */

type RGB = [number, number, number];

/** Colours of a `width` × `height` field, row by row from the top; NaN is transparent. */
export function raster(
  values: ArrayLike<number>,
  width: number,
  height: number,
  colour: (value: number) => RGB,
): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  if (!context) return canvas;
  const image = context.createImageData(width, height);
  for (let i = 0; i < width * height; i++) {
    const value = values[i] ?? NaN;
    if (Number.isNaN(value)) continue;
    const [r, g, b] = colour(value);
    [image.data[4 * i], image.data[4 * i + 1], image.data[4 * i + 2], image.data[4 * i + 3]] = [r, g, b, 255];
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

/** A bar that says what the colours mean, drawn into `context` at (x, y). */
export function colourBar(
  context: CanvasRenderingContext2D,
  box: { x: number; y: number; width: number; height: number },
  colour: (t: number) => RGB,
  labels: readonly [string, string, string],
  ink: string,
): void {
  const run = context.createLinearGradient(box.x, 0, box.x + box.width, 0);
  for (let t = 0; t <= 1; t += 1 / 16) run.addColorStop(t, `rgb(${colour(t).join(" ")})`);
  context.fillStyle = run;
  context.fillRect(box.x, box.y, box.width, box.height);
  context.fillStyle = ink;
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "top";
  labels.forEach((label, i) => {
    context.textAlign = (["left", "center", "right"] as const)[i] ?? "left";
    context.fillText(label, box.x + (i * box.width) / 2, box.y + box.height + 4);
  });
}
