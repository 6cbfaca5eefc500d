/** Curves and fields of the distributions, from the exported diagrams. */

import type { Distribution, State } from "../../app/state";
import type { Engine } from "../../engine/client";
import { incidence } from "../../engine/surface";
import type { Manifest } from "../../files/manifest";
import { direction, packed } from "../../geometry/directions";

const one = (x: number): Float32Array => Float32Array.of(x);

async function ask(
  engine: Engine,
  manifest: Manifest,
  what: string,
  rows: number,
  inputs: Record<string, Float32Array>,
  d?: Distribution,
): Promise<Float32Array> {
  const entry = manifest.find(what, d);
  if (!entry) throw new Error(`The file of ${what}${d ? ` for ${d}` : ""} is missing: run “make lab”.`);
  const outputs = await engine.run({ file: entry.file, rows, inputs });
  return Object.values(outputs)[0]?.data ?? new Float32Array(0);
}

/** Lowest stretched z of reflections against their longitude [rad]: old cap, new cap, and the bound. */
export async function capCurves(
  engine: Engine,
  manifest: Manifest,
  state: State,
  n: number,
): Promise<{ phi: Float32Array; delta: [Float32Array, Float32Array, Float32Array] }> {
  const phi = Float32Array.from({ length: n }, (_, i) => -Math.PI + (2 * Math.PI * i) / (n - 1));
  const up = { ...state, theta: state.theta > 89 ? 180 - state.theta : state.theta };
  const inputs = { wi: packed([incidence(up)]), phi, alpha: one(state.alpha), alpha_y: one(state.alphaY) };
  const all = await ask(engine, manifest, "caps", n, inputs);
  const column = (c: number): Float32Array => Float32Array.from({ length: n }, (_, i) => all[3 * i + c] ?? NaN);
  return { phi, delta: [column(0), column(1), column(2)] };
}

/** G1 on the full sphere against θ [rad], at the azimuth of the light. */
export async function maskingCurve(
  engine: Engine,
  manifest: Manifest,
  state: State,
  d: Distribution,
  n: number,
): Promise<{ theta: Float32Array; G1: Float32Array }> {
  const theta = Float32Array.from({ length: n }, (_, i) => (Math.PI * (i + 0.5)) / n);
  const wi = packed(Array.from(theta, (t) => direction(t, (state.phi * Math.PI) / 180)));
  const inputs = { wi, alpha: one(state.alpha), alpha_y: one(state.alphaY), gamma: one(state.gamma) };
  return { theta, G1: await ask(engine, manifest, "G1", n, inputs, d) };
}

export interface Field {
  title: string;
  /** Row by row from the largest μ down, α to the right. */
  values: Float32Array;
}

/** Cells along α and μ. */
export const FIELD = { alphas: 48, mus: 48 };

/** G1 of GTR over (α, μ) for γ = 0 … 4. */
export async function closedFields(
  engine: Engine,
  manifest: Manifest,
  alpha: readonly [number, number],
  mu: readonly [number, number],
): Promise<Field[]> {
  const grid = cells(alpha, mu);
  const rows = grid.mu.length;
  const all = await ask(engine, manifest, "closed-forms", rows, { mu: grid.mu, roughness: grid.alpha });
  return [0, 1, 2, 3, 4].map((k) => ({
    title: `γ = ${k}`,
    values: Float32Array.from({ length: rows }, (_, i) => all[5 * i + k] ?? NaN),
  }));
}

/** |G1 of γ = 4 − G1 of γ = 10| over (α, μ). */
export async function farField(
  engine: Engine,
  manifest: Manifest,
  alpha: readonly [number, number],
  mu: readonly [number, number],
): Promise<Field> {
  const grid = cells(alpha, mu);
  const rows = grid.mu.length;
  const wi = packed(Array.from(grid.mu, (m) => direction(Math.atan(1 / m), 0)));
  const [four, ten] = await Promise.all([
    ask(engine, manifest, "closed-forms", rows, { mu: grid.mu, roughness: grid.alpha }),
    ask(engine, manifest, "G1", rows, { wi, alpha: grid.alpha, gamma: one(10) }, "gtr"),
  ]);
  return { title: "|γ 4 − γ 10|", values: ten.map((x, i) => Math.abs((four[5 * i + 4] ?? NaN) - x)) };
}

function cells(
  alpha: readonly [number, number],
  mu: readonly [number, number],
): { alpha: Float32Array; mu: Float32Array } {
  const { alphas, mus } = FIELD;
  const between = (range: readonly [number, number], t: number): number => range[0] + (range[1] - range[0]) * t;
  const n = alphas * mus;
  return {
    alpha: Float32Array.from({ length: n }, (_, i) => between(alpha, ((i % alphas) + 0.5) / alphas)),
    mu: Float32Array.from({ length: n }, (_, i) => between(mu, 1 - (Math.floor(i / alphas) + 0.5) / mus)),
  };
}
