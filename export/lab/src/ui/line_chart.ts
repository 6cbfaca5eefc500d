/** A chart of lines over a horizontal axis, with units, on a canvas. */

import { short } from "../numbers/format";
import { paint } from "./dom";
import { themeColour } from "./palette";

export interface Line {
  x: ArrayLike<number>;
  y: ArrayLike<number>;
  colour: string;
  dash?: number[];
  width?: number;
  /** Half width of a band around the line. */
  band?: ArrayLike<number>;
}

export interface Axes {
  title?: string;
  xLabel: string;
  yLabel: string;
  xRange: readonly [number, number];
  xTicks: readonly number[];
  yRange?: readonly [number, number];
  log?: boolean;
  /** A dashed horizontal line at zero. */
  zero?: boolean;
}

const MARGIN = { left: 48, right: 12, top: 24, bottom: 34 };

export function lineChart(canvas: HTMLCanvasElement, axes: Axes, lines: readonly Line[]): void {
  paint(canvas, (context, width, height) => {
    const range = axes.yRange ?? reach(lines, axes);
    const inner = { w: width - MARGIN.left - MARGIN.right, h: height - MARGIN.top - MARGIN.bottom };
    const scale = (y: number): number => (axes.log ? Math.log10(Math.max(y, range[0] / 10)) : y);
    const [low, high] = [scale(range[0]), scale(range[1])];
    const X = (x: number): number => MARGIN.left + (inner.w * (x - axes.xRange[0])) / (axes.xRange[1] - axes.xRange[0]);
    const Y = (y: number): number => MARGIN.top + inner.h * (1 - (scale(y) - low) / (high - low || 1));
    frame(context, axes, range, X, Y, width, height);
    context.save();
    context.beginPath();
    context.rect(MARGIN.left, MARGIN.top - 1, inner.w, inner.h + 2);
    context.clip();
    for (const line of lines) stroke(context, line, X, Y);
    context.restore();
  });
}

/** From zero (or four decades below) to a little above the highest value. */
function reach(lines: readonly Line[], axes: Axes): readonly [number, number] {
  let top = 0;
  for (const line of lines) for (let i = 0; i < line.y.length; i++) top = Math.max(top, finite(line.y[i]));
  top = top > 0 ? top : 1;
  return axes.log ? [top * 1e-4, top * 1.5] : [0, top * 1.08];
}

function finite(x: number | undefined): number {
  return x !== undefined && Number.isFinite(x) ? x : 0;
}

function frame(
  context: CanvasRenderingContext2D,
  axes: Axes,
  range: readonly [number, number],
  X: (x: number) => number,
  Y: (y: number) => number,
  width: number,
  height: number,
): void {
  const [ink, faint] = [themeColour("--soft"), themeColour("--line")];
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  const bottom = height - MARGIN.bottom;
  context.fillStyle = ink;
  context.strokeStyle = faint;
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const x of axes.xTicks) {
    segment(context, X(x), MARGIN.top, X(x), bottom);
    context.fillText(String(x).replace("-", "−"), X(x), bottom + 5);
  }
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const y of yTicks(range, axes.log ?? false)) {
    segment(context, MARGIN.left, Y(y), width - MARGIN.right, Y(y));
    context.fillText(short(y).replace("-", "−"), MARGIN.left - 5, Y(y));
  }
  context.textAlign = "center";
  context.textBaseline = "bottom";
  context.fillText(axes.xLabel, (MARGIN.left + width - MARGIN.right) / 2, height - 1);
  context.textBaseline = "top";
  context.textAlign = "left";
  context.fillText(axes.yLabel, 4, 4);
  if (axes.title) {
    context.fillStyle = themeColour("--ink");
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "right";
    context.fillText(axes.title, width - MARGIN.right, 4);
  }
  if (axes.zero) {
    context.strokeStyle = ink;
    segment(context, MARGIN.left, Y(0), width - MARGIN.right, Y(0));
  }
}

function segment(context: CanvasRenderingContext2D, x0: number, y0: number, x1: number, y1: number): void {
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
}

/** Round numbers within a range, or decades. */
export function yTicks([low, high]: readonly [number, number], log: boolean): number[] {
  const ticks: number[] = [];
  if (log) {
    for (let e = Math.ceil(Math.log10(low)); e <= Math.log10(high); e++) ticks.push(10 ** e);
    return ticks;
  }
  const raw = (high - low) / 4;
  const unit = 10 ** Math.floor(Math.log10(raw));
  const step = unit * ([1, 2, 5, 10].find((m) => m * unit >= raw) ?? 10);
  for (let y = Math.ceil(low / step) * step; y <= high + 1e-12; y += step) ticks.push(Number(y.toPrecision(6)));
  return ticks;
}

function stroke(
  context: CanvasRenderingContext2D,
  line: Line,
  X: (x: number) => number,
  Y: (y: number) => number,
): void {
  const n = line.x.length;
  const at = (array: ArrayLike<number>, i: number): number => array[i] ?? NaN;
  if (line.band) {
    context.beginPath();
    for (let i = 0; i < n; i++) context.lineTo(X(at(line.x, i)), Y(at(line.y, i) + at(line.band, i)));
    for (let i = n - 1; i >= 0; i--) context.lineTo(X(at(line.x, i)), Y(at(line.y, i) - at(line.band, i)));
    context.fillStyle = line.colour;
    context.globalAlpha = 0.18;
    context.fill();
    context.globalAlpha = 1;
  }
  context.beginPath();
  let open = false;
  for (let i = 0; i < n; i++) {
    const y = at(line.y, i);
    if (!Number.isFinite(y)) {
      open = false;
      continue;
    }
    if (open) context.lineTo(X(at(line.x, i)), Y(y));
    else context.moveTo(X(at(line.x, i)), Y(y));
    open = true;
  }
  context.strokeStyle = line.colour;
  context.lineWidth = line.width ?? 1.8;
  context.setLineDash(line.dash ?? []);
  context.stroke();
  context.setLineDash([]);
}
