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

/** The model of 3-D and numbers: the chosen one, or the first that holds (exact, then Distilled). */
export function mainModel(manifest: Manifest, state: State): Entry | null {
  const list = manifest.models(state).filter((m) => m.reason === null);
  const named = (name: string): Entry | undefined => list.find((m) => m.entry.model === name)?.entry;
  const wanted = state.model === "invariance" || state.model === "height-walk" ? "exact" : state.model;
  const exact = list.find((m) => m.entry.exact)?.entry;
  return (wanted === "exact" ? exact : named(wanted)) ?? named("distilled") ?? exact ?? list[0]?.entry ?? null;
}

/** The model against which the first is held; the exact one stands for either of its names. */
export function secondModel(manifest: Manifest, state: State): Entry | null {
  const against = mainModel(manifest, { ...state, model: state.against });
  return against ?? null;
}
