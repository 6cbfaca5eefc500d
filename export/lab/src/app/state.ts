/** What the page shows: one flat record, which the address holds. */

import type { Bounce, Channel } from "../numbers/orders";

export type View = "lobes" | "energy" | "surface" | "graphs";
export type Material = "conductor" | "dielectric" | "diffuse";
export type Distribution = "ggx" | "beckmann" | "gtr";
export type Scale = "linear" | "log";
export type Tint = "bounce" | "colour";
export type Theme = "auto" | "light" | "dark";

export interface State {
  view: View;
  material: Material;
  distribution: Distribution;
  /** Roughness along x and y [1]. */
  alpha: number;
  alphaY: number;
  /** Whether both are the same. */
  round: boolean;
  /** Exponent of GTR [1]. */
  gamma: number;
  /** Chemical symbol, or "F1" for a perfect mirror. */
  metal: string;
  /** Relative index of glass [1]. */
  eta: number;
  albedo: number;
  /** Directions in degrees. */
  theta: number;
  phi: number;
  outTheta: number;
  outPhi: number;
  /** The model in 3-D and in the numbers, that against which it is held, and those in the plots. */
  model: string;
  against: string;
  models: string[];
  bounce: Bounce;
  channel: Channel;
  scale: Scale;
  /** What the colours of the lobe in 3-D say: the share of each bounce, or the colour of the light. */
  tint: Tint;
  /** Paths after which an exact model is no longer averaged. */
  paths: number;
  /** Position of the slider between one bounce and all [0, 1]. */
  split: number;
  /** Ray-traced case: roughness "0.5" or "1,0.1", and angle of incidence in radians. */
  traced: string;
  tracedTheta: number;
  theme: Theme;
}

export const START: State = {
  view: "lobes",
  material: "conductor",
  distribution: "ggx",
  alpha: 0.6,
  alphaY: 0.6,
  round: true,
  gamma: 2,
  metal: "Au",
  eta: 1.5,
  albedo: 0.8,
  theta: 50,
  phi: 180,
  outTheta: 50,
  outPhi: 0,
  model: "distilled",
  against: "kulla-conty",
  models: ["distilled", "single-bounce", "kulla-conty"],
  bounce: "all",
  channel: "Y",
  scale: "linear",
  tint: "bounce",
  paths: 512,
  split: 0.5,
  traced: "0.5",
  tracedTheta: 1,
  theme: "auto",
};

/** Smallest and largest value of each number. */
export const RANGES = {
  alpha: [0.05, 1],
  alphaY: [0.05, 1],
  gamma: [0.5, 6],
  eta: [1.05, 2.5],
  albedo: [0, 1],
  theta: [0, 180],
  phi: [-180, 180],
  outTheta: [0, 180],
  outPhi: [-180, 180],
  paths: [1, 65536],
  split: [0, 1],
  tracedTheta: [0, 1.57],
} as const satisfies Partial<Record<keyof State, readonly [number, number]>>;

export type NumberKey = keyof typeof RANGES;

/** Words that a key may take. */
export const CHOICES = {
  view: ["lobes", "energy", "surface", "graphs"],
  material: ["conductor", "dielectric", "diffuse"],
  distribution: ["ggx", "beckmann", "gtr"],
  bounce: ["all", "1", "2", "3", "4+", "2+"],
  channel: ["Y", "R", "G", "B"],
  scale: ["linear", "log"],
  tint: ["bounce", "colour"],
  theme: ["auto", "light", "dark"],
} as const;

/** What one choice rules out of others: a state that holds together. */
export function consistent(state: State): State {
  const s = { ...state };
  // GTR is round; a metal or chalk is lit from above.
  if (s.distribution === "gtr") s.round = true;
  if (s.round) s.alphaY = s.alpha;
  if (s.material !== "dielectric") s.theta = Math.min(s.theta, 89);
  // A direction in the horizon itself belongs to neither side.
  if (Math.abs(s.theta - 90) < 1) s.theta = s.theta < 90 ? 89 : 91;
  return s;
}
