/** Files to take away: a picture of the view, or its numbers. */

import { themeColour } from "../ui/palette";

export function saveText(text: string, name: string): void {
  save(new Blob([text], { type: "text/csv" }), name);
}

/** The canvases of a view, side by side on the page's ground, as one PNG. */
export function savePicture(canvases: readonly HTMLCanvasElement[], caption: string, name: string): void {
  const gap = 24;
  const seen = canvases.filter((canvas) => canvas.width > 0 && canvas.height > 0);
  const height = Math.max(1, ...seen.map((canvas) => canvas.height));
  const width = seen.reduce((sum, canvas) => sum + canvas.width + gap, gap);
  const sheet = document.createElement("canvas");
  [sheet.width, sheet.height] = [Math.max(width, 640), height + 2 * gap + 40];
  const context = sheet.getContext("2d");
  if (!context) return;
  context.fillStyle = themeColour("--card");
  context.fillRect(0, 0, sheet.width, sheet.height);
  let x = gap;
  for (const canvas of seen) {
    context.drawImage(canvas, x, gap);
    x += canvas.width + gap;
  }
  context.fillStyle = themeColour("--soft");
  context.font = "18px system-ui, sans-serif";
  context.fillText(caption, gap, sheet.height - gap);
  sheet.toBlob((blob) => blob && save(blob, name));
}

function save(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  window.setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
