/** The grid on which a lobe is drawn: rings around a pole, denser next to it, that fill one hemisphere to its rim. */

import { cross, normalized, type Vec3 } from "./directions";

export interface LobeGrid {
  /** The pole, then ring after ring. */
  directions: Vec3[];
  /** Corners of triangles. */
  triangles: Uint32Array;
}

/** `side` is +1 for the upper hemisphere, −1 for the lower; `alpha` says how narrow the lobe is. */
export function lobeGrid(pole: Vec3, side: 1 | -1, alpha: number, rings: number, spokes: number): LobeGrid {
  const m = inside(pole, side);
  // e1 is the direction in which the rim is nearest or farthest, e2 lies level.
  const level = Math.hypot(m[0], m[1]);
  const e2: Vec3 = level > 1e-6 ? normalized([-m[1], m[0], 0]) : [0, 1, 0];
  const e1 = cross(e2, m);
  const power = densest(alpha, rings);
  const directions: Vec3[] = [m];
  for (let r = 1; r <= rings; r++) {
    const s = Math.pow(r / rings, power);
    for (let k = 0; k < spokes; k++) {
      const chi = (2 * Math.PI * k) / spokes;
      const [c, d] = [Math.cos(chi), Math.sin(chi)];
      // Where the arc from m along c e1 + d e2 meets the horizon: cos ψ m_z + sin ψ c e1_z = 0.
      const rim = Math.atan2(side * m[2], -side * c * e1[2]);
      const psi = rim * s * 0.9999;
      const [a, b] = [Math.cos(psi), Math.sin(psi)];
      directions.push(
        normalized([
          a * m[0] + b * (c * e1[0] + d * e2[0]),
          a * m[1] + b * (c * e1[1] + d * e2[1]),
          a * m[2] + b * (c * e1[2] + d * e2[2]),
        ]),
      );
    }
  }
  return { directions, triangles: fan(rings, spokes) };
}

/** The pole, not nearer to the horizon than a few degrees. */
function inside(pole: Vec3, side: 1 | -1): Vec3 {
  return normalized([pole[0], pole[1], side * Math.max(side * pole[2], 0.05)]);
}

/** The exponent that puts the first ring at about a quarter of alpha. */
function densest(alpha: number, rings: number): number {
  return Math.max(1, Math.min(2.6, Math.log(alpha / 5) / Math.log(1 / rings)));
}

/** Seen from outside, triangles run counter-clockwise: (e1, e2, m) is right-handed on both sides. */
function fan(rings: number, spokes: number): Uint32Array {
  const out: number[] = [];
  const at = (r: number, k: number): number => (r === 0 ? 0 : 1 + (r - 1) * spokes + (k % spokes));
  const add = (a: number, b: number, c: number): void => void out.push(a, b, c);
  for (let k = 0; k < spokes; k++) {
    add(0, at(1, k), at(1, k + 1));
    for (let r = 1; r < rings; r++) {
      add(at(r, k), at(r + 1, k), at(r + 1, k + 1));
      add(at(r, k), at(r + 1, k + 1), at(r, k + 1));
    }
  }
  return Uint32Array.from(out);
}
