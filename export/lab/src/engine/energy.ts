/** Energies of a lobe by quadrature: the mean of value / density over directions that the exported sampler draws. */

import type { State } from "../app/state";
import type { Entry, Manifest } from "../files/manifest";
import { packed } from "../geometry/directions";
import { Orders } from "../numbers/orders";
import type { Engine } from "./client";
import { incidence, lobe, parameters } from "./surface";

/** Directions of the quadrature while something moves, and at rest. */
export const COARSE = 1021;
export const FINE = 8191;

export interface Energy {
  /** One row each: share of the light that leaves on the side it came from, and on the other [1]. */
  reflected: Orders;
  transmitted: Orders;
}

export interface Nodes {
  wo: Float32Array;
  pdf: Float32Array;
}

/** Directions and their density [1/sr] for the state's surface. */
export async function nodes(engine: Engine, manifest: Manifest, state: State, n: number): Promise<Nodes> {
  const sampler = manifest.sampler(state);
  if (!sampler) throw new Error(`there is no file that draws directions for ${state.material} ${state.distribution}`);
  const inputs = { ...parameters(state, manifest), wi: packed([incidence(state)]) };
  const outputs = await engine.run({ file: sampler.file, rows: 1, inputs, random: { seed: "lattice", paths: n } });
  const { wo, pdf } = outputs;
  if (!wo || !pdf) throw new Error(`${sampler.file} does not give wo and pdf`);
  return { wo: wo.data, pdf: pdf.data };
}

/** Energies of one model on these nodes; one of random walks takes one path a node, of `seed`. */
export async function energy(
  engine: Engine,
  manifest: Manifest,
  state: State,
  entry: Entry,
  at: Nodes,
  seed: number,
): Promise<Energy> {
  const wi = incidence(state);
  const random = entry.random ? { random: { seed, paths: 1 } } : {};
  const found = await lobe(engine, {
    entry,
    wi: packed([wi]),
    wo: at.wo,
    parameters: parameters(state, manifest),
    ...random,
  });
  return integrated(found, at, wi[2] >= 0 ? 1 : -1);
}

/** Means of value / density over both sides; a draw of density zero counts as nothing. */
export function integrated(lobes: Orders, at: Nodes, side: 1 | -1): Energy {
  const size = lobes.labels.length * lobes.channels;
  const sums = [new Float64Array(size), new Float64Array(size)] as const;
  for (let row = 0; row < lobes.rows; row++) {
    const pdf = at.pdf[row] ?? 0;
    if (!(pdf > 0)) continue;
    const to = sums[side * (at.wo[3 * row + 2] ?? 0) > 0 ? 0 : 1];
    for (let i = 0; i < size; i++) to[i] = (to[i] ?? 0) + (lobes.data[row * size + i] ?? 0) / pdf;
  }
  const [reflected, transmitted] = sums.map(
    (sum) =>
      new Orders(
        lobes.labels,
        Float32Array.from(sum, (x) => x / lobes.rows),
        1,
        lobes.channels,
      ),
  );
  return { reflected: reflected as Orders, transmitted: transmitted as Orders };
}

/** The mean of two energies of so many equal passes each. */
export function meanEnergy(a: Energy, nA: number, b: Energy): Energy {
  const mean = (x: Orders, y: Orders): Orders =>
    new Orders(
      x.labels,
      x.data.map((v, i) => v + ((y.data[i] ?? 0) - v) / (nA + 1)),
      1,
      x.channels,
    );
  return { reflected: mean(a.reflected, b.reflected), transmitted: mean(a.transmitted, b.transmitted) };
}
