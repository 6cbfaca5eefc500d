/** Numbers in [0, 1): a low-discrepancy sequence for quadrature, and a seeded generator for random walks. */

/** The generalised golden ratio of `d` dimensions: the root of x^(d+1) = x + 1 above one. */
function goldenRatio(d: number): number {
  let x = 1.5;
  for (let i = 0; i < 60; i++) x = Math.pow(1 + x, 1 / (d + 1));
  return x;
}

/** `n` points of `d` dimensions, point after point: frac(1/2 + (i + 1) / g^j), an additive recurrence. */
export function lattice(n: number, d: number): Float32Array {
  const g = goldenRatio(d);
  const points = new Float32Array(n * d);
  for (let j = 0; j < d; j++) {
    const step = Math.pow(1 / g, j + 1) % 1;
    for (let i = 0; i < n; i++) points[i * d + j] = below1((0.5 + (i + 1) * step) % 1);
  }
  return points;
}

/** `n` uniform numbers of the generator mulberry32 with this seed. */
export function uniforms(seed: number, n: number): Float32Array {
  const numbers = new Float32Array(n);
  let a = seed >>> 0;
  for (let i = 0; i < n; i++) {
    a = (a + 0x6d2b79f5) >>> 0;
    let t = a;
    t = Math.imul(t ^ (t >>> 15), t | 1);
    t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
    // 24 bits: each is a float32, and none rounds to one.
    numbers[i] = ((t ^ (t >>> 14)) >>> 8) / 16777216;
  }
  return numbers;
}

/** The float32 nearest to x, but not one. */
function below1(x: number): number {
  return Math.min(Math.fround(x), 1 - 2 ** -24);
}
