/** The third view: lobes of explicit surfaces, ray-traced, under the models of the same surface. */

import { MIRROR } from "../../files/manifest";
import { alphaName, loadTallies, traced, type Tallies, type Traced } from "../../files/tallies";
import type { State } from "../../app/state";
import { consistent } from "../../app/state";
import { follow } from "../../engine/follow";
import { Latest } from "../../engine/latest";
import type { Bounce, Orders } from "../../numbers/orders";
import { direction, packed } from "../../geometry/directions";
import { short } from "../../numbers/format";
import { segmented } from "../../ui/controls";
import { el, onResize } from "../../ui/dom";
import { legend } from "../../ui/legend";
import { lineChart, type Line } from "../../ui/line_chart";
import { modelStyle, themeColour } from "../../ui/palette";
import { card } from "../card";
import { shown, type Context, type Table, type View } from "../context";

const PANELS: readonly Bounce[] = ["1", "2", "3", "4+", "all"];
const NAMES = ["1 bounce", "2 bounces", "3 bounces", "4 or more", "all bounces"];

export class SurfaceView implements View {
  private readonly card = card("The microsurface itself", "", "traced");
  readonly element: HTMLElement;
  private readonly charts = PANELS.map((bounce) => el("canvas", { role: "img", id: `traced-${bounce}` }));
  private readonly keys = el("div");
  private readonly work: Latest<State>;
  private tallies: Tallies | null = null;
  private case: Traced | null = null;
  private lobes = new Map<string, Orders>();

  constructor(private readonly context: Context) {
    const { store } = context;
    const alphas = [
      ["0.25", "α 0.25"],
      ["0.5", "α 0.5"],
      ["1", "α 1"],
      ["1,0.1", "α 1 × 0.1"],
    ] as const;
    const chooser = el(
      "div",
      { class: "chooser" },
      segmented(store, "traced", "Roughness", alphas),
      this.angles(),
      el("button", { type: "button", class: "quiet", onclick: () => this.take() }, "Open this surface in Lobes"),
    );
    const charts = el("div", { class: "panels" }, ...this.charts);
    this.card.body.append(chooser, charts, this.keys);
    this.element = el("div", { class: "view" }, this.card.element);
    this.work = new Latest((state, stale) => this.compute(state, stale), context.complain);
    onResize(charts, () => this.redraw(store.state));
  }

  private angles(): HTMLElement {
    const { store } = this.context;
    const group = el("div", { class: "segmented", role: "radiogroup", "aria-label": "Angle of incidence" });
    for (const theta of [0, 0.5, 1, 1.5]) {
      const input = el("input", {
        type: "radio",
        name: "choose-tracedTheta",
        id: `tracedTheta-${theta}`,
        value: theta,
      });
      input.checked = store.state.tracedTheta === theta;
      input.addEventListener("change", () => store.set({ tracedTheta: theta }));
      store.subscribe((state) => void (input.checked = state.tracedTheta === theta));
      group.append(el("span", {}, input, el("label", { for: input.id }, `${theta} rad`)));
    }
    return el("div", { class: "field" }, el("span", { class: "caption" }, "Angle of incidence θi"), group);
  }

  /** The state of the models for the case: Beckmann normals, facets that absorb nothing, glass of 1.5. */
  private modelled(state: State, found: Traced): State {
    const [alpha, alphaY] = found.alpha;
    const surface = {
      distribution: "beckmann",
      alpha,
      alphaY,
      round: alpha === alphaY,
      metal: MIRROR,
      eta: 1.5,
      albedo: 1,
    } as const;
    return consistent({ ...state, ...surface, theta: (found.theta * 180) / Math.PI, phi: 0 });
  }

  private take(): void {
    if (this.case) this.context.store.set({ ...this.modelled(this.context.store.state, this.case), view: "lobes" });
  }

  update(state: State): void {
    this.work.request(state);
  }

  private async compute(state: State, stale: () => boolean): Promise<void> {
    this.tallies ??= await loadTallies();
    const found = traced(this.tallies, state.material, state.traced, state.tracedTheta);
    if (!found) throw new Error("This surface is not among the traced ones.");
    const { manifest, slow: engine } = this.context;
    const like = this.modelled(state, found);
    const exact = state.material === "dielectric" ? "height-walk" : "invariance";
    const entries = shown(manifest, like, [...state.models, exact]);
    const wo = packed(found.angle.map((angle) => direction(angle, Math.PI)));
    const task = { engine, manifest, state: { ...like, paths: Math.max(state.paths, 2048) }, entries, wo, pass: 64 };
    this.case = found;
    this.lobes = new Map();
    this.redraw(state);
    await follow(task, stale, (now) => {
      this.lobes = now.lobes;
      this.redraw(this.context.store.state);
    });
  }

  redraw(state: State): void {
    const found = this.case;
    if (!found) return;
    const degrees = found.angle.map((angle) => (angle * 180) / Math.PI);
    const glass = found.material === "dielectric";
    PANELS.forEach((bounce, i) => {
      const canvas = this.charts[i];
      if (!canvas) return;
      const lines = this.lines(found, degrees, bounce, i);
      const energy =
        i < 4 ? [found.reflected[i] ?? 0, found.transmitted[i] ?? 0] : [sum(found.reflected), sum(found.transmitted)];
      const title = `${NAMES[i]} · E ${short(energy[0] ?? 0)}${glass ? ` + ${short(energy[1] ?? 0)}` : ""}`;
      const range = glass ? ([-180, 180] as const) : ([-90, 90] as const);
      const xTicks = glass ? [-180, -90, 0, 90, 180] : [-90, -45, 0, 45, 90];
      const xLabel = "angle in the plane of incidence [°]";
      lineChart(canvas, { title, xLabel, yLabel: "[1/sr]", xRange: range, xTicks, log: state.scale === "log" }, lines);
      canvas.setAttribute("aria-label", `Traced surface and models, ${title}`);
    });
    const names = { conductor: "metal, F = 1", dielectric: "glass, η = 1.5", diffuse: "chalk, albedo 1" };
    this.card.note.textContent =
      `Light paths traced on Gaussian surfaces, ${names[found.material]}, ` +
      `α = ${alphaName(found.alpha)}, θi = ${found.theta} rad: ` +
      "f · |cos θo| [1/sr] with two standard errors; E is the share of the light [1]. " +
      (this.lobes.size ? "Over it the models, the exact one always." : "The models are being evaluated …");
    const keys = [...this.lobes.keys()].map((model) => modelStyle(model));
    const band = { name: "traced surface ± 2σ", colour: themeColour("--traced"), fill: true };
    this.keys.replaceChildren(legend([band, ...keys]));
  }

  private lines(found: Traced, x: number[], bounce: Bounce, index: number): Line[] {
    const band = (found.stderr[index] ?? []).map((e) => 2 * e);
    const lines: Line[] = [{ x, y: found.value[index] ?? [], band, colour: themeColour("--traced"), width: 4 }];
    for (const [model, orders] of this.lobes) {
      const { colour, dash } = modelStyle(model);
      if (orders.has(bounce)) lines.push({ x, y: orders.column(bounce, "Y"), colour, dash, width: 1.6 });
    }
    return lines;
  }

  tables(): Table[] {
    const found = this.case;
    if (!found) return [];
    const head = [
      "angle in the plane of incidence [rad]",
      ...NAMES.flatMap((n) => [`${n} [1/sr]`, `${n}, standard error [1/sr]`]),
    ];
    const rows = found.angle.map((angle, row) => [
      angle,
      ...PANELS.flatMap((_, i) => [found.value[i]?.[row] ?? 0, found.stderr[i]?.[row] ?? 0]),
    ]);
    return [{ name: `traced ${found.material} ${alphaName(found.alpha)} theta ${found.theta}`, head, rows }];
  }

  canvases(): HTMLCanvasElement[] {
    return this.charts;
  }
}

function sum(values: readonly number[]): number {
  return values.reduce((a, b) => a + b, 0);
}
