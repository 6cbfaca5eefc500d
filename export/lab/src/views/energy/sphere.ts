/** The pixels of a sphere that is seen from far away: local frames, and the eye in each. */

import { cross, normalized, type Vec3 } from "../../geometry/directions";

export interface Sphere {
  size: number;
  /** Pixels on the sphere, as indices of the square. */
  cells: Uint32Array;
  /** Direction to the eye in the frame of each pixel (n, 3). */
  wi: Float32Array;
  frames: readonly { x: Vec3; y: Vec3; z: Vec3 }[];
}

/** A sphere that fills `share` of a square of `size` pixels. */
export function sphere(size: number, share: number): Sphere {
  const cells: number[] = [];
  const frames: { x: Vec3; y: Vec3; z: Vec3 }[] = [];
  const wi: number[] = [];
  for (let j = 0; j < size; j++) {
    for (let i = 0; i < size; i++) {
      const px = ((2 * (i + 0.5)) / size - 1) / share;
      const py = (1 - (2 * (j + 0.5)) / size) / share;
      const r2 = px * px + py * py;
      if (r2 >= 0.9985) continue;
      const z: Vec3 = [px, py, Math.sqrt(1 - r2)];
      // The tangent x runs around the vertical axis, along which metal is brushed.
      const x = normalized(cross([0, 1, 0], z));
      const y = cross(z, x);
      // The eye lies at (0, 0, 1).
      wi.push(x[2], y[2], z[2]);
      cells.push(j * size + i);
      frames.push({ x, y, z });
    }
  }
  return { size, cells: Uint32Array.from(cells), wi: Float32Array.from(wi), frames };
}

/** The direction (x, y, z) of the frame of a pixel, in the world. */
export function inWorld(frame: Sphere["frames"][number], d: Vec3): Vec3 {
  return [0, 1, 2].map(
    (c) => d[0] * (frame.x[c] ?? 0) + d[1] * (frame.y[c] ?? 0) + d[2] * (frame.z[c] ?? 0),
  ) as unknown as Vec3;
}
