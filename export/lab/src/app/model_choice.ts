/** The models in the plots: a box to tick for each, with its line; those that do not hold say why. */

import type { Manifest } from "../files/manifest";
import { el } from "../ui/dom";
import { modelStyle } from "../ui/palette";
import type { State } from "./state";
import type { Store } from "./store";

export function modelChoice(store: Store, manifest: Manifest): HTMLElement {
  const list = el("div", { class: "ticks", role: "group", "aria-label": "Models in the plots" });
  let drawn = "";
  const draw = (state: State): void => {
    const models = manifest.models(state);
    const key = JSON.stringify([models.map((m) => [m.entry.model, m.reason]), state.models]);
    if (key === drawn) return;
    drawn = key;
    const held = document.activeElement?.id;
    list.replaceChildren(
      ...models.map(({ entry, reason }) => {
        const name = entry.model ?? "";
        const input = el("input", { type: "checkbox", id: `model-${name}`, disabled: reason !== null });
        input.checked = state.models.includes(name) && reason === null;
        input.addEventListener("change", () =>
          store.set({ models: switched(store.state.models, name, input.checked) }),
        );
        const label = el("label", { for: input.id }, modelStyle(name).name, reason ? ` – ${reason}` : "");
        return el("div", { class: "tick" }, input, label);
      }),
    );
    if (held?.startsWith("model-")) document.getElementById(held)?.focus();
  };
  store.subscribe(draw);
  draw(store.state);
  return el("div", { class: "field", "data-key": "models" }, el("span", { class: "caption" }, "In the plots"), list);
}

/** The list with a name in it, or without it. */
export function switched(models: readonly string[], name: string, on: boolean): string[] {
  const others = models.filter((each) => each !== name);
  return on ? [...others, name] : others;
}
