/** Light or dark: as the system has it, or as the state says. */

import type { State } from "./state";
import type { Store } from "./store";

const dark = window.matchMedia("(prefers-color-scheme: dark)");

export function followTheme(store: Store, restyle: () => void): void {
  const apply = (state: State): void => {
    const theme = state.theme === "auto" ? (dark.matches ? "dark" : "light") : state.theme;
    if (document.documentElement.dataset["theme"] === theme) return;
    document.documentElement.dataset["theme"] = theme;
    restyle();
  };
  store.subscribe(apply);
  dark.addEventListener("change", () => apply(store.state));
  apply(store.state);
}
