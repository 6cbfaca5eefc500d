/** Light around the spheres: a furnace, the same from everywhere, and a studio. A picture, not physics. */

import type { Vec3 } from "../../geometry/directions";

type RGB = readonly [number, number, number];

interface Box {
  towards: Vec3;
  /** Cosines at which the light is full, and at which it ends. */
  inner: number;
  outer: number;
  light: RGB;
}

const BOXES: readonly Box[] = [
  { towards: [-0.62, 0.66, 0.42], inner: 0.93, outer: 0.6, light: [3.4, 3.3, 3.1] },
  { towards: [0.86, 0.1, 0.5], inner: 0.95, outer: 0.72, light: [1.3, 1.6, 2.1] },
  { towards: [0.1, 0.35, -0.93], inner: 0.92, outer: 0.7, light: [1.4, 1.2, 1.0] },
];

/** Radiance of the furnace. */
export const FURNACE: RGB = [0.5, 0.5, 0.5];

/** Radiance from a direction of the world: x to the right, y up, z towards the eye. */
export function studio(d: Vec3): RGB {
  const up = 0.5 + 0.5 * d[1];
  const out: [number, number, number] = [0.12 + 0.5 * up, 0.13 + 0.55 * up, 0.16 + 0.66 * up];
  if (d[1] < 0) for (let c = 0; c < 3; c++) out[c] = (out[c] ?? 0) * (1 + 0.6 * d[1]);
  for (const box of BOXES) {
    const cosine = d[0] * box.towards[0] + d[1] * box.towards[1] + d[2] * box.towards[2];
    const t = Math.max(0, Math.min(1, (cosine - box.outer) / (box.inner - box.outer)));
    const weight = t * t * (3 - 2 * t);
    for (let c = 0; c < 3; c++) out[c] = (out[c] ?? 0) + weight * (box.light[c] ?? 0);
  }
  return out;
}

/** What is seen behind the sphere: the studio without its lamps. */
export function backdrop(y: number): RGB {
  const up = 0.5 + 0.5 * y;
  return [0.05 + 0.16 * up, 0.06 + 0.18 * up, 0.08 + 0.22 * up];
}

/** sRGB in [0, 255] of linear light; highlights roll off. */
export function display(x: number, soft: boolean): number {
  const y = soft ? (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14) : x;
  const clipped = Math.max(0, Math.min(1, y));
  return 255 * (clipped <= 0.0031308 ? 12.92 * clipped : 1.055 * clipped ** (1 / 2.4) - 0.055);
}
