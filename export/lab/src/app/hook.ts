/** What a test asks of the page: the numbers with all digits, and whether they have settled. */

import type { State } from "./state";
import type { Store } from "./store";
import type { Engine } from "../engine/client";
import type { LobesView } from "../views/lobes/lobes_view";

export interface Numbers {
  model: string;
  labels: readonly string[];
  channels: number;
  value: number[];
  reflected: number[];
  transmitted: number[];
}

/** Pictures of the lobe, lobes in them, answers of the evaluators that follow the hand and their time [ms], so far. */
export interface Counts {
  frames: number;
  updates: number;
  answers: number;
  ms: number;
}

declare global {
  interface Window {
    lab?: {
      state(): State;
      set(change: Partial<State>): void;
      numbers(): Numbers | null;
      counts(): Counts;
      /** Where the handles of the two directions are on the page [px]. */
      handles(): [number, number][];
      /** Draws the lobe to its last pixel: how long that took [ms]. */
      picture(): number;
    };
  }
}

export function installHook(store: Store, lobes: LobesView, fast: Engine): void {
  window.lab = {
    state: () => store.state,
    set: (change) => store.set(change),
    numbers: () => {
      const found = lobes.numbers.settled(store.state);
      if (!found) return null;
      const { model, value, energy } = found;
      return {
        model,
        labels: value.labels,
        channels: value.channels,
        value: [...value.data],
        reflected: [...energy.reflected.data],
        transmitted: [...energy.transmitted.data],
      };
    },
    counts: () => ({ frames: lobes.stage.stage.frames, updates: lobes.stage.updates, ...fast.spent }),
    handles: () => lobes.stage.handles.places(),
    picture: () => lobes.stage.stage.timed(),
  };
}
