/** Energies of models at the state's direction: coarse at once, fine at rest, averaged on for exact models. */

import type { State } from "../../app/state";
import { COARSE, energy, FINE, meanEnergy, nodes, type Energy } from "../../engine/energy";
import { Latest } from "../../engine/latest";
import type { Entry } from "../../files/manifest";
import type { Context } from "../context";

/** Passes over the fine nodes that an exact model is averaged over. */
const PASSES = 24;

export interface Energies {
  of: Map<string, Energy>;
  /** Directions of the quadrature [1], and passes over them. */
  nodes: number;
  passes: number;
  /** Whether nothing more is to come. */
  settled: boolean;
}

export class LiveEnergy {
  private readonly work: Latest<{ state: State; entries: readonly Entry[] }>;

  constructor(
    private readonly context: Context,
    private readonly show: (now: Energies) => void,
  ) {
    this.work = new Latest(({ state, entries }, stale) => this.compute(state, entries, stale), context.complain);
  }

  request(state: State, entries: readonly Entry[]): void {
    this.work.request({ state, entries });
  }

  private async compute(state: State, entries: readonly Entry[], stale: () => boolean): Promise<void> {
    const { manifest, slow } = this.context;
    for (const n of [COARSE, FINE]) {
      const at = await nodes(slow, manifest, state, n);
      const of = new Map<string, Energy>();
      for (const entry of entries) {
        // The coarse ones are shown while a hand moves.
        if (n === FINE && stale()) return;
        of.set(entry.model ?? "", await energy(slow, manifest, state, entry, at, 1));
      }
      const exact = entries.filter((entry) => entry.random);
      this.show({ of, nodes: n, passes: 1, settled: n === FINE && exact.length === 0 && !stale() });
      if (stale()) return;
      if (n === FINE && exact.length > 0) await this.refine(state, exact, at, of, stale);
    }
  }

  private async refine(
    state: State,
    exact: readonly Entry[],
    at: Awaited<ReturnType<typeof nodes>>,
    of: Map<string, Energy>,
    stale: () => boolean,
  ): Promise<void> {
    const { manifest, slow } = this.context;
    const passes = Math.min(PASSES, state.paths);
    for (let pass = 1; pass < passes; pass++) {
      for (const entry of exact) {
        const next = await energy(slow, manifest, state, entry, at, pass + 1);
        if (stale()) return;
        const before = of.get(entry.model ?? "");
        if (before) of.set(entry.model ?? "", meanEnergy(before, pass, next));
      }
      this.show({ of, nodes: FINE, passes: pass + 1, settled: pass + 1 === passes });
    }
  }
}
