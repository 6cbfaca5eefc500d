/** What every view is given. */

import type { Store } from "../app/store";
import type { State } from "../app/state";
import type { Engine } from "../engine/client";
import type { Entry, Manifest } from "../files/manifest";

export interface Context {
  store: Store;
  manifest: Manifest;
  /** For what must follow the hand, and for what may take longer. */
  fast: Engine;
  slow: Engine;
  /** Shows a sentence about what went wrong. */
  complain(error: Error | string): void;
}

/** The numbers behind a view: a table for the CSV, whose heads carry the units. */
export interface Table {
  name: string;
  head: string[];
  rows: (string | number)[][];
}

export interface View {
  element: HTMLElement;
  /** Called when the view comes into sight and whenever the state changes while it is. */
  update(state: State): void;
  tables(): Table[];
  /** The canvas that a picture is taken of. */
  canvases(): HTMLCanvasElement[];
}

/** The models that are drawn: the chosen ones that hold for the surface. */
export function shown(manifest: Manifest, state: State, names: readonly string[]): Entry[] {
  const list: Entry[] = [];
  for (const { entry, reason } of manifest.models(state)) {
    if (reason === null && names.includes(entry.model ?? "")) list.push(entry);
  }
  return list;
}

/** The models that hold for the surface, the exact one first. */
function holding(manifest: Manifest, state: State): Entry[] {
  return manifest.models(state).flatMap(({ entry, reason }) => (reason === null ? [entry] : []));
}

/** The one of this name; the exact one stands for either of its names. */
function named(list: readonly Entry[], name: string): Entry | undefined {
  const exact = name === "exact" || name === "invariance" || name === "height-walk";
  return list.find((entry) => (exact ? entry.exact : entry.model === name));
}

/** The model of 3-D and numbers: the chosen one, or the first that holds (Distilled, then exact). */
export function mainModel(manifest: Manifest, state: State): Entry | null {
  const list = holding(manifest, state);
  return named(list, state.model) ?? named(list, "distilled") ?? named(list, "exact") ?? list[0] ?? null;
}

/** The model against which the first is held: the chosen one, or another one that holds. */
export function secondModel(manifest: Manifest, state: State): Entry | null {
  const list = holding(manifest, state);
  const main = mainModel(manifest, state);
  return named(list, state.against) ?? list.find((entry) => entry !== main) ?? main;
}

/** How the state calls a model of the list. */
export function nameOf(entry: Entry | null): string {
  return entry?.exact && !entry.model?.startsWith("dropped") ? "exact" : (entry?.model ?? "");
}
