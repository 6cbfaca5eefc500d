/** Directions in the local frame, +z the macro-normal. */

export type Vec3 = readonly [number, number, number];

export function direction(theta: number, phi: number): Vec3 {
  const s = Math.sin(theta);
  return [s * Math.cos(phi), s * Math.sin(phi), Math.cos(theta)];
}

/** Polar angle and azimuth of a direction; the azimuth in (−π, π]. */
export function angles(d: Vec3): { theta: number; phi: number } {
  return { theta: Math.acos(Math.max(-1, Math.min(1, d[2]))), phi: Math.atan2(d[1], d[0]) };
}

/** Where a flat mirror would send it. */
export function mirrored(d: Vec3): Vec3 {
  return [-d[0], -d[1], d[2]];
}

export function dot(a: Vec3, b: Vec3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function cross(a: Vec3, b: Vec3): Vec3 {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function normalized(a: Vec3): Vec3 {
  const n = Math.hypot(a[0], a[1], a[2]);
  return n > 0 ? [a[0] / n, a[1] / n, a[2] / n] : [0, 0, 1];
}

/** Directions as one array (n, 3). */
export function packed(list: readonly Vec3[]): Float32Array {
  const out = new Float32Array(3 * list.length);
  list.forEach((d, i) => out.set(d, 3 * i));
  return out;
}

/** `n` directions around the plane of `wi`: the angle is 0 at the normal, and positive on the mirror's side. */
export function planeOfIncidence(phi: number, n: number): { angle: Float64Array; directions: Vec3[] } {
  const angle = new Float64Array(n);
  const list: Vec3[] = [];
  for (let i = 0; i < n; i++) {
    const a = -Math.PI + (2 * Math.PI * (i + 0.5)) / n;
    angle[i] = a;
    list.push([-Math.sin(a) * Math.cos(phi), -Math.sin(a) * Math.sin(phi), Math.cos(a)]);
  }
  return { angle, directions: list };
}
