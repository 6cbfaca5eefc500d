/** The list of files that `python -m export.lab_set` writes beside them. */

import type { Distribution, Material, State } from "../app/state";

export interface Entry {
  file: string;
  bytes: number;
  what: string;
  material?: Material;
  distribution?: Distribution;
  model?: string;
  /** Whether its lobe is a mean over random walks: it is averaged while one looks. */
  random?: boolean;
  /** Whether that mean is the theory itself, all bounces one by one. */
  exact?: boolean;
  isotropic?: boolean;
  /** Bounces that each order counts. */
  orders?: string[];
}

export interface Metal {
  name: string;
  eta: number[];
  k: number[];
}

/** A perfect mirror, F = 1: the limit k → ∞ of a metal (here 1 − F = 4e-10). */
export const MIRROR = "F1";

export class Manifest {
  readonly entries: Entry[];
  readonly metals: Map<string, Metal>;

  constructor(
    readonly version: string,
    entries: readonly Entry[],
    metals: Record<string, Metal>,
  ) {
    this.entries = [...entries];
    this.metals = new Map(Object.entries(metals));
    this.metals.set(MIRROR, { name: "perfect mirror, F = 1", eta: [1, 1, 1], k: [1e5, 1e5, 1e5] });
  }

  /** Every model there is for a surface, and why some of them do not hold for it. */
  models(state: State): { entry: Entry; reason: string | null }[] {
    const fits = (e: Entry): boolean =>
      e.what === "orders" && e.material === state.material && e.distribution === state.distribution;
    const reason = (e: Entry): string | null =>
      e.isotropic && state.alpha !== state.alphaY ? "holds for αx = αy only" : null;
    return this.entries.filter(fits).map((entry) => ({ entry, reason: reason(entry) }));
  }

  /** The model of this name for a surface, if it holds for it. */
  model(state: State, name: string): Entry | null {
    return this.models(state).find((m) => m.entry.model === name && m.reason === null)?.entry ?? null;
  }

  /** The file that draws directions for a surface; those of chalk are the same for all distributions. */
  sampler(state: State): Entry | null {
    const fits = (e: Entry): boolean =>
      e.what === "sample" &&
      e.material === state.material &&
      (e.material === "diffuse" || e.distribution === state.distribution);
    return this.entries.find(fits) ?? null;
  }

  find(what: string, distribution?: Distribution): Entry | null {
    return this.entries.find((e) => e.what === what && (!distribution || e.distribution === distribution)) ?? null;
  }
}

export async function loadManifest(): Promise<Manifest> {
  const answer = await fetch("models/models.json");
  if (!answer.ok) throw new Error("models/models.json is missing: run “make lab”, which writes the evaluators.");
  const content = (await answer.json()) as { torchms: string; models: Entry[]; metals: Record<string, Metal> };
  return new Manifest(content.torchms, content.models, content.metals);
}
