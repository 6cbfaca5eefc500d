/** Numbers in [0, 1): a low-discrepancy sequence for quadrature, and a seeded generator for random walks. */

/** Multiplier of Korobov's lattice for each prime number of points: they make P2 small in three and four dimensions. */
const KOROBOV: Record<number, number> = { 251: 64, 1021: 413, 8191: 1564 };

/** Components of the generating vector: powers of the multiplier modulo n. */
function generator(n: number, d: number): number[] {
  const a = KOROBOV[n];
  if (a === undefined) throw new Error(`there is a lattice of ${Object.keys(KOROBOV).join(", ")} points; got ${n}`);
  const z = [1];
  while (z.length < d) z.push(((z[z.length - 1] ?? 1) * a) % n);
  return z;
}

/** `n` points of `d` dimensions, point after point: frac((i z + 1/2) / n), a rank-1 lattice. */
export function lattice(n: number, d: number): Float32Array {
  const z = generator(n, d);
  const points = new Float32Array(n * d);
  for (let i = 0; i < n; i++) z.forEach((zj, j) => (points[i * d + j] = below1((((i * zj) % n) + 0.5) / n)));
  return points;
}

/** Turns after which every row has seen a whole lattice. */
export const TURNS = 251;

/** Points of `d` dimensions, each moved on by point `turn` of a lattice (Cranley and Patterson's rotation). */
export function turned(points: Float32Array, d: number, turn: number): Float32Array {
  const steps = generator(TURNS, d).map((z) => ((turn * z) % TURNS) / TURNS);
  return points.map((x, i) => below1((x + (steps[i % d] ?? 0)) % 1));
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
