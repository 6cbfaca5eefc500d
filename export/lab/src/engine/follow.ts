/** Lobes of several models at the same directions: those without noise once, others averaged while one looks. */

import type { State } from "../app/state";
import type { Entry, Manifest } from "../files/manifest";
import { packed } from "../geometry/directions";
import { Orders } from "../numbers/orders";
import type { Engine } from "./client";
import { incidence, lobe, parameters } from "./surface";

export interface Followed {
  /** Mean over the paths so far, by the name of the model. */
  lobes: Map<string, Orders>;
  /** Paths of a model of random walks so far; all of them when it is done. */
  paths: number;
  done: boolean;
}

export interface Task {
  engine: Engine;
  manifest: Manifest;
  state: State;
  entries: readonly Entry[];
  wo: Float32Array;
  /** Paths of one pass. */
  pass: number;
}

/** Calls `show` after every pass, until `state.paths` are averaged or the task is stale. The first pass is shown even then:
 * under a hand that does not rest, the picture is one answer behind instead of standing still. */
export async function follow(task: Task, stale: () => boolean, show: (now: Followed) => void): Promise<void> {
  const { engine, manifest, state, entries, wo } = task;
  const wi = packed([incidence(state)]);
  const shared = { wi, wo, parameters: parameters(state, manifest) };
  const lobes = new Map<string, Orders>();
  let paths = 0;
  for (let pass = 1; ; pass++) {
    const more = Math.min(task.pass, state.paths - paths);
    for (const entry of entries) {
      if (pass > 1 && !entry.random) continue;
      const random = entry.random ? { random: { seed: pass, paths: more } } : {};
      const found = await lobe(engine, { entry, ...shared, ...random });
      if (pass > 1 && stale()) return;
      const before = lobes.get(entry.model ?? "");
      lobes.set(entry.model ?? "", before ? mean(before, paths, found, more) : found);
    }
    paths += more;
    const done = !stale() && (paths >= state.paths || !entries.some((entry) => entry.random));
    show({ lobes, paths, done });
    if (done || stale()) return;
  }
}

/** The mean of two means, each of so many paths. */
function mean(a: Orders, nA: number, b: Orders, nB: number): Orders {
  const data = a.data.map((x, i) => x + ((b.data[i] ?? 0) - x) * (nB / (nA + nB)));
  return new Orders(a.labels, data, a.rows, a.channels);
}
