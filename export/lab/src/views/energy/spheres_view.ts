/** Two spheres of the material, in the furnace and in a studio; a line that is dragged parts one bounce from all. */

import type { State } from "../../app/state";
import { Latest } from "../../engine/latest";
import type { Entry } from "../../files/manifest";
import { el } from "../../ui/dom";
import { modelStyle } from "../../ui/palette";
import { slider } from "../../ui/controls";
import { TURNS } from "../../numbers/sequences";
import { card } from "../card";
import { mainModel, type Context } from "../context";
import { Film } from "./render";

const SIZE = 176;
/** Directions a pixel, after which the picture is good. */
const PASSES = TURNS;

const TITLES = ["White furnace", "Studio"] as const;

export class SpheresView {
  private readonly card = card("One bounce | all bounces", "", "spheres");
  readonly element = this.card.element;
  readonly canvases: readonly HTMLCanvasElement[];
  private readonly film = new Film(SIZE, 0.82);
  private readonly work: Latest<State>;
  private drawn = "";

  constructor(private readonly context: Context) {
    const { store } = context;
    this.canvases = TITLES.map((title, i) =>
      el("canvas", {
        width: SIZE,
        height: SIZE,
        role: "img",
        id: `sphere-${i}`,
        "aria-label": `${title}: a sphere of this material`,
      }),
    );
    const figures = this.canvases.map((canvas, i) => el("figure", {}, canvas, el("figcaption", {}, TITLES[i] ?? "")));
    const parting = slider(store, "split", { label: "one bounce up to here", step: 0.01 });
    this.card.body.append(el("div", { class: "pair" }, ...figures), parting);
    for (const canvas of this.canvases) {
      const part = (event: PointerEvent): void => {
        if (event.type === "pointermove" && event.buttons === 0) return;
        if (event.type === "pointerdown") canvas.setPointerCapture(event.pointerId);
        const box = canvas.getBoundingClientRect();
        store.set({ split: Math.max(0, Math.min(1, (event.clientX - box.left) / box.width)) });
      };
      canvas.addEventListener("pointerdown", part);
      canvas.addEventListener("pointermove", part);
    }
    this.work = new Latest((state, stale) => this.compute(state, stale), context.complain);
  }

  update(state: State): void {
    const entry = mainModel(this.context.manifest, state);
    const { theta: _t, phi: _p, outTheta: _o, outPhi: _q, split: _s, ...surface } = state;
    const key = JSON.stringify([entry?.file, surface]);
    if (key === this.drawn) this.redraw(state);
    else {
      this.drawn = key;
      this.work.request(state);
    }
  }

  /** Out of sight: no more passes. */
  stop(): void {
    this.drawn = "";
    this.work.request({ ...this.context.store.state, paths: 0 });
  }

  private async compute(state: State, stale: () => boolean): Promise<void> {
    if (state.paths === 0) return;
    const { manifest, slow } = this.context;
    const entry = mainModel(manifest, state);
    if (!entry) return;
    this.film.clear();
    while (this.film.passes < PASSES) {
      const before = this.film.passes;
      await this.film.add(slow, manifest, state, entry, stale);
      if (stale() || this.film.passes === before) return;
      this.note(entry, state);
      this.redraw(this.context.store.state);
    }
  }

  private note(entry: Entry, state: State): void {
    const glass =
      state.material === "dielectric" ? "; light that passes goes straight on, without a second surface" : "";
    this.card.note.textContent =
      `${modelStyle(entry.model ?? "").name}, ${this.film.passes} of ${PASSES} directions a pixel${glass}. ` +
      "In the furnace a sphere that absorbs nothing is invisible once all bounces are counted.";
  }

  redraw(state: State): void {
    this.canvases.forEach((canvas, i) => {
      const context = canvas.getContext("2d");
      if (!context) return;
      context.putImageData(this.film.picture(i as 0 | 1, state.split), 0, 0);
      context.fillStyle = "rgb(255 255 255 / 75%)";
      context.fillRect(state.split * SIZE - 0.4, 0, 0.8, SIZE);
    });
  }
}
