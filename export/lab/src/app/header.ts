/** The head of the page: its name, the four views, and what can be taken away. */

import { segmented } from "../ui/controls";
import { el } from "../ui/dom";
import type { Store } from "./store";

export interface Actions {
  picture(): void;
  numbers(): void;
}

export function header(store: Store, version: string, actions: Actions): HTMLElement {
  const views = segmented(store, "view", "View", [
    ["lobes", "Lobes"],
    ["energy", "Energy"],
    ["surface", "Microsurface"],
    ["graphs", "Graphs"],
  ]);
  views.classList.add("views");
  const copied = el("span", { role: "status", class: "unseen" });
  const share = el("button", { type: "button", id: "copy-link" }, "Link");
  share.addEventListener("click", () => {
    const say = (text: string): void => {
      share.textContent = copied.textContent = text;
      window.setTimeout(() => (share.textContent = "Link"), 1600);
    };
    // Without a secure context there is no clipboard: the address bar has it, too.
    navigator.clipboard?.writeText(store.address()).then(
      () => say("Copied"),
      () => say("See address"),
    );
    if (!navigator.clipboard) say("See address");
  });
  const theme = segmented(store, "theme", "Theme", [
    ["auto", "Auto"],
    ["light", "Light"],
    ["dark", "Dark"],
  ]);
  theme.classList.add("theme");
  return el(
    "header",
    {},
    el("img", { src: "./icon.svg", alt: "", width: 30, height: 30 }),
    el("h1", {}, "Lobe lab"),
    el("span", { class: "version" }, `torchms ${version}`),
    views,
    el(
      "div",
      { class: "actions" },
      el("button", { type: "button", id: "save-picture", onclick: () => actions.picture() }, "Picture"),
      el("button", { type: "button", id: "save-numbers", onclick: () => actions.numbers() }, "CSV"),
      share,
      copied,
      theme,
    ),
  );
}
