/** Colours that colour-blind people can tell apart (Okabe and Ito), and the words for what they mean. */

import type { Bounce } from "../numbers/orders";

export const BOUNCE_COLOURS: Record<string, string> = {
  "1": "#0072b2",
  "2": "#e69f00",
  "3": "#009e73",
  "4+": "#cc79a7",
  "2+": "#56b4e9",
  "1+": "#0072b2",
};

export const BOUNCE_NAMES: Record<Bounce | "1+", string> = {
  all: "all bounces",
  "1": "1 bounce",
  "2": "2 bounces",
  "3": "3 bounces",
  "4+": "4 or more",
  "2+": "2 or more",
  "1+": "all bounces",
};

export interface ModelStyle {
  name: string;
  colour: string;
  /** Lengths of dashes and gaps [px]: lines differ without colour, too. */
  dash: number[];
}

const STYLES: Record<string, ModelStyle> = {
  invariance: { name: "Exact (invariance)", colour: "var-ink", dash: [] },
  "height-walk": { name: "Exact (height walk)", colour: "var-ink", dash: [] },
  distilled: { name: "Distilled", colour: "#d55e00", dash: [] },
  "kulla-conty": { name: "Kulla–Conty", colour: "#56b4e9", dash: [7, 3] },
  turquin: { name: "Turquin", colour: "#009e73", dash: [8, 3, 2, 3] },
  "single-bounce": { name: "One bounce", colour: "#0072b2", dash: [2, 3] },
};

export function modelStyle(model: string): ModelStyle {
  const known = STYLES[model] ?? { name: model.replace("dropped:", "▾ "), colour: "#cc79a7", dash: [10, 4] };
  return { ...known, colour: known.colour === "var-ink" ? themeColour("--ink") : known.colour };
}

/** Colours of the theme that were looked up: to ask the style sheet costs a new layout of the page. */
const known = new Map<string, string>();

/** A colour of the theme, as the style sheet has it now. */
export function themeColour(name: string): string {
  const root = document.documentElement;
  const key = `${root.dataset["theme"]} ${name}`;
  const colour = known.get(key) ?? (getComputedStyle(root).getPropertyValue(name).trim() || "#888");
  known.set(key, colour);
  return colour;
}

/** Whether dark letters are the readable ones on a colour "#rrggbb" (luminance as WCAG 2 has it). */
export function isLight(colour: string): boolean {
  const channels = /^#(..)(..)(..)$/.exec(colour)?.slice(1) ?? [];
  const [r = 0, g = 0, b = 0] = channels.map((hex) => (parseInt(hex, 16) / 255) ** 2.2);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.25;
}

type RGB = [number, number, number];

function ramp(stops: readonly RGB[], t: number): RGB {
  const x = Math.max(0, Math.min(1, t)) * (stops.length - 1);
  const i = Math.min(Math.floor(x), stops.length - 2);
  const [a, b] = [stops[i] as RGB, stops[i + 1] as RGB];
  return [0, 1, 2].map((c) => Math.round((a[c] as number) + ((b[c] as number) - (a[c] as number)) * (x - i))) as RGB;
}

const CIVIDIS: RGB[] = [
  [0, 32, 81],
  [60, 77, 110],
  [127, 124, 117],
  [187, 175, 113],
  [253, 234, 69],
];
const VIRIDIS: RGB[] = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
];
const BLUE: RGB[] = [
  [33, 102, 172],
  [103, 169, 207],
  [209, 229, 240],
  [247, 247, 247],
];
const ORANGE: RGB[] = [
  [247, 247, 247],
  [253, 219, 184],
  [241, 163, 64],
  [179, 88, 6],
];

/** Dark blue to yellow, as grey as it is colourful. */
export const cividis = (t: number): RGB => ramp(CIVIDIS, t);
export const viridis = (t: number): RGB => ramp(VIRIDIS, t);

const STEPS = 128;
const DIVERGING = Array.from({ length: 2 * STEPS + 1 }, (_, i) =>
  i < STEPS ? ramp(BLUE, i / STEPS) : ramp(ORANGE, i / STEPS - 1),
);

/** Blue for −1, white for 0, orange for 1. */
export function diverging(t: number): RGB {
  return DIVERGING[Math.round(STEPS * (1 + Math.max(-1, Math.min(1, t))))] as RGB;
}

export function hexToRgb(hex: string): RGB {
  const n = parseInt(hex.slice(1), 16);
  return [n >> 16, (n >> 8) & 255, n & 255];
}
