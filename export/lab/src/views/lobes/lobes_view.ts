/** The first view: the lobe from all sides. */

import type { State } from "../../app/state";
import { el } from "../../ui/dom";
import type { Context, Table, View } from "../context";
import { MapView } from "./map_view";
import { NumbersView } from "./numbers_view";
import { PlaneView } from "./plane_view";
import { StageView } from "./stage_view";

export class LobesView implements View {
  readonly stage: StageView;
  readonly plane: PlaneView;
  readonly map: MapView;
  readonly numbers: NumbersView;
  readonly element: HTMLElement;

  constructor(private readonly context: Context) {
    this.stage = new StageView(context);
    this.plane = new PlaneView(context);
    this.map = new MapView(context);
    this.numbers = new NumbersView(context);
    const parts = [this.stage, this.plane, this.numbers, this.map].map((part) => part.element);
    this.element = el("div", { class: "view lobes" }, ...parts);
  }

  update(state: State): void {
    this.stage.update(state);
    this.plane.update(state);
    this.numbers.update(state);
    this.map.update(state);
  }

  /** Another bounce, channel or scale: nothing is evaluated anew. */
  redraw(state: State): void {
    for (const part of [this.stage, this.plane, this.numbers, this.map]) part.redraw(state);
  }

  restyle(): void {
    this.stage.restyle();
    this.redraw(this.context.store.state);
  }

  tables(): Table[] {
    const { state } = this.context.store;
    return [this.plane.table(state), this.numbers.table(state)];
  }

  canvases(): HTMLCanvasElement[] {
    // What WebGL drew is kept until the page is shown, and not longer.
    this.stage.stage.render();
    return [this.stage.canvas, this.plane.canvas, this.map.canvas];
  }
}
