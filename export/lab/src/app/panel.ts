/** The controls beside the views. */

import { MIRROR, type Manifest } from "../files/manifest";
import { menu, segmented, slider, toggle } from "../ui/controls";
import { el } from "../ui/dom";
import { modelStyle } from "../ui/palette";
import { mainModel, nameOf, secondModel } from "../views/context";
import { modelChoice } from "./model_choice";
import type { State, View } from "./state";
import type { Store } from "./store";

export function panel(store: Store, manifest: Manifest, drop: HTMLElement): HTMLElement {
  const element = el(
    "aside",
    { class: "panel", "aria-label": "Controls" },
    surface(store, manifest),
    light(store),
    look(store),
    models(store, manifest),
    drop,
  );
  const follow = (state: State): void => {
    for (const field of element.querySelectorAll<HTMLElement>("[data-key]")) {
      field.hidden = !applies(field.dataset["key"] ?? "", state);
    }
  };
  store.subscribe(follow);
  follow(store.state);
  return element;
}

/** Controls that a view does without. */
const UNUSED: Record<View, readonly string[]> = {
  lobes: [],
  energy: ["outTheta", "outPhi", "bounce", "scale", "tint", "against", "models"],
  surface: [
    ...["distribution", "alpha", "alphaY", "round", "metal", "eta", "albedo", "gamma", "theta", "phi"],
    ...["outTheta", "outPhi", "bounce", "tint", "channel", "model", "against"],
  ],
  graphs: [
    ...["material", "distribution", "metal", "eta", "albedo", "outTheta", "outPhi"],
    ...["bounce", "scale", "tint", "channel", "model", "against", "models"],
  ],
};

/** Whether a control means anything for the state. */
export function applies(key: string, state: State): boolean {
  if (UNUSED[state.view].includes(key)) return false;
  const isGlass = state.material === "dielectric";
  const needs: Record<string, boolean> = {
    metal: state.material === "conductor",
    eta: isGlass,
    albedo: state.material === "diffuse",
    alphaY: !state.round,
    round: state.distribution !== "gtr",
    gamma: state.distribution === "gtr" || state.view === "graphs",
    channel: !isGlass,
    tint: !isGlass,
  };
  return needs[key] ?? true;
}

function group(title: string, ...children: HTMLElement[]): HTMLElement {
  return el("fieldset", {}, el("legend", {}, title), ...children);
}

function surface(store: Store, manifest: Manifest): HTMLElement {
  const names = [...manifest.metals].map(
    ([symbol, metal]) => [symbol, symbol === MIRROR ? metal.name : `${metal.name} (${symbol})`] as const,
  );
  return group(
    "Surface",
    segmented(store, "material", "Material", [
      ["conductor", "Metal"],
      ["dielectric", "Glass"],
      ["diffuse", "Chalk"],
    ]),
    segmented(store, "distribution", "Normals", [
      ["ggx", "GGX"],
      ["beckmann", "Beckmann"],
      ["gtr", "GTR"],
    ]),
    slider(store, "alpha", { label: "Roughness α", step: 0.01 }),
    slider(store, "alphaY", { label: "Roughness αy", step: 0.01 }),
    toggle(store, "round", "Brushed: αx and αy differ", true),
    slider(store, "gamma", { label: "Tail of GTR, γ", step: 0.1 }),
    menu(store, "metal", "Metal (measured spectra)", () => names),
    slider(store, "eta", { label: "Index η", step: 0.01 }),
    slider(store, "albedo", { label: "Albedo of the facets", step: 0.01 }),
  );
}

function light(store: Store): HTMLElement {
  return group(
    "Directions",
    slider(store, "theta", { label: "Incidence θi", unit: "°", step: 0.5 }),
    slider(store, "phi", { label: "Azimuth φi", unit: "°", step: 1 }),
    slider(store, "outTheta", { label: "Numbers at θo", unit: "°", step: 0.5 }),
    slider(store, "outPhi", { label: "Azimuth φo", unit: "°", step: 1 }),
  );
}

function look(store: Store): HTMLElement {
  return group(
    "Shown",
    segmented(store, "bounce", "Bounces", [
      ["all", "all"],
      ["1", "1"],
      ["2", "2"],
      ["3", "3"],
      ["4+", "≥ 4"],
      ["2+", "≥ 2"],
    ]),
    segmented(store, "scale", "Scale", [
      ["linear", "linear"],
      ["log", "log"],
    ]),
    segmented(store, "tint", "Colours of the lobe", [
      ["bounce", "by bounce"],
      ["colour", "of the light"],
    ]),
    segmented(store, "channel", "Channel", [
      ["Y", "luminance"],
      ["R", "R"],
      ["G", "G"],
      ["B", "B"],
    ]),
  );
}

function models(store: Store, manifest: Manifest): HTMLElement {
  const named = (state: State): readonly (readonly [string, string])[] =>
    manifest
      .models(state)
      .filter((m) => m.reason === null)
      .map(({ entry }) => [nameOf(entry), modelStyle(entry.model ?? "").name] as const);
  return group(
    "Models",
    menu(store, "model", "In 3-D and numbers", named, (state) => nameOf(mainModel(manifest, state))),
    menu(store, "against", "Held against", named, (state) => nameOf(secondModel(manifest, state))),
    modelChoice(store, manifest),
  );
}
