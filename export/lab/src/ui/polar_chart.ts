/** A lobe in a plane: angle around, value outwards; the surface is the horizontal line. */

import { short } from "../numbers/format";
import { paint } from "./dom";
import type { Line } from "./line_chart";
import { themeColour } from "./palette";

export interface Polar {
  /** Angle from the normal [rad], positive to the right. */
  lines: readonly Line[];
  log: boolean;
  /** Whether the lower half is shown. */
  whole: boolean;
  /** Angle of the light, on the left if it is positive. */
  light: number;
}

/** Decades that the logarithmic scale shows. */
export const DECADES = 4;

export function polarChart(canvas: HTMLCanvasElement, polar: Polar): void {
  paint(canvas, (context, width, height) => {
    const top = Math.max(1e-12, ...polar.lines.map((line) => highest(line.y)));
    const radius = polar.whole ? Math.min(width / 2 - 34, height / 2 - 20) : Math.min(width / 2 - 34, height - 48);
    const centre = { x: width / 2, y: polar.whole ? height / 2 : height - 26 };
    const R = (v: number): number =>
      polar.log ? radius * Math.max(0, 1 + Math.log10(Math.max(v, 1e-30) / top) / DECADES) : (radius * v) / top;
    rings(context, centre, radius, top, R, polar);
    for (const line of polar.lines) curve(context, line, centre, R);
    arrow(context, centre, radius, polar.light);
  });
}

function highest(values: ArrayLike<number>): number {
  let top = 0;
  for (let i = 0; i < values.length; i++) if ((values[i] ?? 0) > top) top = values[i] ?? 0;
  return top;
}

type Point = { x: number; y: number };

function rings(
  context: CanvasRenderingContext2D,
  c: Point,
  radius: number,
  top: number,
  R: (v: number) => number,
  polar: Polar,
): void {
  const [ink, faint] = [themeColour("--soft"), themeColour("--line")];
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  context.strokeStyle = faint;
  const end = polar.whole ? 2 * Math.PI : Math.PI;
  const values = polar.log
    ? Array.from({ length: DECADES }, (_, k) => top / 10 ** k)
    : [0.25, 0.5, 0.75, 1].map((share) => share * top);
  context.fillStyle = ink;
  for (const value of values) {
    context.beginPath();
    context.arc(c.x, c.y, R(value), -Math.PI, -Math.PI + end);
    context.stroke();
  }
  for (let a = polar.whole ? -150 : -60; a <= (polar.whole ? 180 : 60); a += 30) spoke(context, c, radius, a);
  context.strokeStyle = ink;
  context.beginPath();
  context.moveTo(c.x - radius - 12, c.y);
  context.lineTo(c.x + radius + 12, c.y);
  context.stroke();
  context.fillStyle = ink;
  context.textAlign = "left";
  context.textBaseline = "top";
  context.fillText(`outer ring ${short(top)} /sr${polar.log ? `, ${DECADES} decades` : ""}`, 6, 4);
}

function spoke(context: CanvasRenderingContext2D, c: Point, radius: number, degrees: number): void {
  const a = (degrees * Math.PI) / 180;
  const [x, y] = [Math.sin(a), -Math.cos(a)];
  context.beginPath();
  context.moveTo(c.x, c.y);
  context.lineTo(c.x + radius * x, c.y + radius * y);
  context.stroke();
  context.textAlign = "center";
  context.textBaseline = "middle";
  if (Math.abs(degrees) !== 90)
    context.fillText(`${Math.abs(degrees)}°`, c.x + (radius + 13) * x, c.y + (radius + 11) * y);
}

function curve(context: CanvasRenderingContext2D, line: Line, c: Point, R: (v: number) => number): void {
  context.beginPath();
  for (let i = 0; i < line.x.length; i++) {
    const [a, r] = [line.x[i] ?? 0, R(Number.isFinite(line.y[i]) ? (line.y[i] ?? 0) : 0)];
    context.lineTo(c.x + r * Math.sin(a), c.y - r * Math.cos(a));
  }
  context.closePath();
  if (line.band) {
    context.globalAlpha = 0.13;
    context.fillStyle = line.colour;
    context.fill();
    context.globalAlpha = 1;
  }
  context.strokeStyle = line.colour;
  context.lineWidth = line.width ?? 1.8;
  context.lineJoin = "round";
  context.setLineDash(line.dash ?? []);
  context.stroke();
  context.setLineDash([]);
}

/** Where the light comes from. */
function arrow(context: CanvasRenderingContext2D, c: Point, radius: number, angle: number): void {
  const [x, y] = [-Math.sin(angle), -Math.cos(angle)];
  context.strokeStyle = context.fillStyle = themeColour("--light");
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(c.x + radius * x, c.y + radius * y);
  context.lineTo(c.x + 10 * x, c.y + 10 * y);
  context.stroke();
  context.beginPath();
  context.arc(c.x + radius * x, c.y + radius * y, 5, 0, 2 * Math.PI);
  context.fill();
}
