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
    image.data.set([...colour(value), 255], 4 * i);
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
  for (let i = 0; i < box.width; i++) {
    context.fillStyle = `rgb(${colour(i / (box.width - 1)).join(" ")})`;
    context.fillRect(box.x + i, box.y, 1.5, box.height);
  }
  context.fillStyle = ink;
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "top";
  labels.forEach((label, i) => {
    context.textAlign = (["left", "center", "right"] as const)[i] ?? "left";
    context.fillText(label, box.x + (i * box.width) / 2, box.y + box.height + 4);
  });
}
