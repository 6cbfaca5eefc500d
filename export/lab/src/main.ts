/** The lobe lab: state in, views out. */

import "./style.css";
import { dropZone } from "./app/drop";
import { header } from "./app/header";
import { installHook } from "./app/hook";
import { panel } from "./app/panel";
import type { State } from "./app/state";
import { Store } from "./app/store";
import { followTheme } from "./app/theme";
import { decode } from "./app/url";
import { Engine } from "./engine/client";
import { loadManifest } from "./files/manifest";
import { csv } from "./takeaway/csv";
import { savePicture, saveText } from "./takeaway/save";
import { el } from "./ui/dom";
import { EnergyView } from "./views/energy/energy_view";
import type { Context } from "./views/context";
import { GraphsView } from "./views/graphs/graphs_view";
import { LobesView } from "./views/lobes/lobes_view";
import { SurfaceView } from "./views/surface/surface_view";

/** Keys that change how things look, not what is evaluated. */
const LOOKS = new Set<keyof State>(["bounce", "channel", "scale", "tint", "split", "theme"]);

/** A line for what went wrong, which goes when it is pressed. */
function notice(): { element: HTMLElement; complain: (error: Error | string) => void } {
  const text = el("span");
  const close = el("button", { type: "button", "aria-label": "Close" }, "×");
  const element = el("div", { class: "notice", role: "alert", hidden: true }, text, close);
  close.addEventListener("click", () => (element.hidden = true));
  return {
    element,
    complain: (error) => {
      text.textContent = typeof error === "string" ? error : `That did not work: ${error.message.replace(/\.$/, "")}.`;
      element.hidden = false;
    },
  };
}

/** On a phone the controls are a sheet over the page: the button that opens it. */
function sheetButton(): HTMLElement {
  const button = el("button", { type: "button", class: "sheet", "aria-expanded": "false" }, "Controls");
  button.addEventListener("click", () => {
    const open = document.body.classList.toggle("sheet-open");
    button.setAttribute("aria-expanded", String(open));
    button.textContent = open ? "Done" : "Controls";
  });
  return button;
}

async function start(app: HTMLElement): Promise<void> {
  const store = new Store(decode(location.hash));
  const { element: alert, complain } = notice();
  const manifest = await loadManifest();
  const fast = new Engine();
  const context: Context = { store, manifest, fast, slow: new Engine(fast.ready), complain };
  let restyle = (): void => undefined;
  followTheme(store, () => restyle());
  const lobes = new LobesView(context);
  const energy = new EnergyView(context);
  const views = { lobes, energy, surface: new SurfaceView(context), graphs: new GraphsView(context) };
  const stage = el("main", {}, ...Object.values(views).map((view) => view.element));
  const controls = panel(store, manifest, dropZone(store, manifest, [context.fast, context.slow], complain));
  const fileName = (ending: string): string => `lobe-lab-${store.state.view}.${ending}`;
  const head = header(store, manifest.version, {
    picture: () => savePicture(views[store.state.view].canvases(), store.address(), fileName("png")),
    numbers: () => saveText(csv(views[store.state.view].tables(), store.address()), fileName("csv")),
  });
  app.replaceChildren(head, alert, el("div", { class: "page" }, stage, controls), sheetButton());

  const show = (state: State): void => {
    for (const [name, view] of Object.entries(views)) view.element.hidden = name !== state.view;
    document.body.dataset["view"] = state.view;
  };
  store.subscribe((state, changed) => {
    show(state);
    if (changed.has("view") && state.view !== "energy") energy.hide();
    const view = views[state.view];
    if ([...changed].every((key) => LOOKS.has(key))) {
      if (view instanceof LobesView || view instanceof EnergyView || view instanceof SurfaceView) view.redraw(state);
    } else view.update(state);
  });
  restyle = () => {
    lobes.restyle();
    for (const view of Object.values(views)) if (view !== lobes) view.redraw(store.state);
  };
  installHook(store, lobes, fast);
  show(store.state);
  views[store.state.view].update(store.state);
}

const app = document.getElementById("app");
if (app) {
  start(app).catch((error: Error) => {
    app.replaceChildren(el("p", { class: "loading", role: "alert" }, `The lab could not start: ${error.message}`));
  });
}
