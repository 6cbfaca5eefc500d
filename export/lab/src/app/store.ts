/** Holds the state, tells who listens what has changed, and keeps the address in step. */

import { consistent, type State } from "./state";
import { decode, encode } from "./url";

type Listener = (state: State, changed: ReadonlySet<keyof State>) => void;

export class Store {
  private listeners: Listener[] = [];
  private timer = 0;
  private shown: string;

  constructor(public state: State) {
    this.shown = encode(state);
    window.addEventListener("hashchange", () => {
      if (location.hash.replace(/^#/, "") !== this.shown) this.set(decode(location.hash));
    });
  }

  set(change: Partial<State>): void {
    const before = this.state;
    this.state = consistent({ ...before, ...change });
    const changed = new Set<keyof State>();
    for (const key of Object.keys(this.state) as (keyof State)[]) {
      if (String(this.state[key]) !== String(before[key])) changed.add(key);
    }
    if (changed.size === 0) return;
    for (const listener of this.listeners) listener(this.state, changed);
    // Browsers allow some hundred changes of an address in half a minute: not one a frame.
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.writeAddress(), 250);
  }

  subscribe(listener: Listener): void {
    this.listeners.push(listener);
  }

  /** The address that shows this state. */
  address(): string {
    return `${location.origin}${location.pathname}#${encode(this.state)}`;
  }

  private writeAddress(): void {
    this.shown = encode(this.state);
    history.replaceState(null, "", this.shown ? `#${this.shown}` : location.pathname + location.search);
  }
}
