/** What a test asks of the page: the numbers with all digits, and whether they have settled. */

import type { State } from "./state";
import type { Store } from "./store";
import type { LobesView } from "../views/lobes/lobes_view";

export interface Numbers {
  model: string;
  labels: readonly string[];
  channels: number;
  value: number[];
  reflected: number[];
  transmitted: number[];
}

declare global {
  interface Window {
    lab?: {
      state(): State;
      set(change: Partial<State>): void;
      numbers(): Numbers | null;
      counts(): { frames: number; updates: number };
    };
  }
}

export function installHook(store: Store, lobes: LobesView): void {
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
    counts: () => ({ frames: lobes.stage.stage.frames, updates: lobes.stage.updates }),
  };
}
