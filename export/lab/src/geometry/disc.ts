/** A hemisphere as a disc of equal areas (Lambert's azimuthal projection): each cell is the same solid angle. */

import type { Vec3 } from "./directions";

export interface Disc {
  /** Cells along an edge of the square around the disc. */
  size: number;
  /** Cells inside, as indices of the square, row by row. */
  cells: Uint32Array;
  directions: Vec3[];
  /** Solid angle of a cell [sr]. */
  solidAngle: number;
}

/** The upper hemisphere (side 1) seen from above, or the lower one (side −1) seen from above as well. */
export function disc(size: number, side: 1 | -1): Disc {
  const cells: number[] = [];
  const directions: Vec3[] = [];
  for (let j = 0; j < size; j++) {
    for (let i = 0; i < size; i++) {
      const x = (2 * (i + 0.5)) / size - 1;
      const y = 1 - (2 * (j + 0.5)) / size;
      const r2 = x * x + y * y;
      if (r2 >= 1) continue;
      const s = Math.sqrt(2 - r2);
      cells.push(j * size + i);
      directions.push([x * s, y * s, side * (1 - r2)]);
    }
  }
  // The square of edge 2 is 4 / π discs of 2π.
  return { size, cells: Uint32Array.from(cells), directions, solidAngle: 8 / (size * size) };
}

/** Where a direction lies in the unit disc. */
export function onDisc(d: Vec3): { x: number; y: number } {
  const s = Math.sqrt(1 + Math.abs(d[2]));
  return { x: d[0] / s, y: d[1] / s };
}
