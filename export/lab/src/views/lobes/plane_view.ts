/** The lobes of all chosen models in the plane of incidence, over each other. */

import type { State } from "../../app/state";
import { follow } from "../../engine/follow";
import { Latest } from "../../engine/latest";
import { packed, planeOfIncidence } from "../../geometry/directions";
import type { Bounce, Orders } from "../../numbers/orders";
import { el, onResize } from "../../ui/dom";
import { legend } from "../../ui/legend";
import type { Line } from "../../ui/line_chart";
import { BOUNCE_COLOURS, BOUNCE_NAMES, modelStyle } from "../../ui/palette";
import { polarChart } from "../../ui/polar_chart";
import { card } from "../card";
import { mainModel, shown, type Context, type Table } from "../context";

const POINTS = 360;

export class PlaneView {
  private readonly card = card(
    "In the plane of incidence",
    "f · |cos θo| [1/sr] against the angle from the normal [°]",
    "plane",
  );
  readonly element = this.card.element;
  readonly canvas = el("canvas", { role: "img", id: "plane" });
  private readonly keys = el("div");
  private readonly work: Latest<State>;
  private lobes = new Map<string, Orders>();
  private angle: Float64Array = new Float64Array(0);

  constructor(private readonly context: Context) {
    this.card.body.append(this.canvas, this.keys);
    this.work = new Latest((state, stale) => this.compute(state, stale), context.complain);
    onResize(this.card.body, () => this.redraw(context.store.state));
  }

  update(state: State): void {
    this.work.request(state);
  }

  private async compute(state: State, stale: () => boolean): Promise<void> {
    const { manifest, fast: engine } = this.context;
    const main = mainModel(manifest, state);
    const entries = shown(manifest, state, [...state.models, main?.model ?? ""]);
    const { angle, directions } = planeOfIncidence((state.phi * Math.PI) / 180, POINTS);
    await follow({ engine, manifest, state, entries, wo: packed(directions), pass: 16 }, stale, (now) => {
      [this.lobes, this.angle] = [now.lobes, angle];
      this.redraw(this.context.store.state);
    });
  }

  redraw(state: State): void {
    const glass = state.material === "dielectric";
    this.element.classList.toggle("whole", glass);
    const lines = this.lines(state);
    // Positive angles lie on the mirror's side, and to the right; the light comes from the left.
    const light = (state.theta * Math.PI) / 180;
    polarChart(this.canvas, { lines, log: state.scale === "log", whole: glass, light });
    const which = `${BOUNCE_NAMES[state.bounce]}, θi = ${state.theta.toFixed(1)}°`;
    this.canvas.setAttribute(
      "aria-label",
      `Lobes in the plane of incidence, ${which}; ${[...this.lobes.keys()].join(", ")}`,
    );
    const models = [...this.lobes.keys()].map((model) => modelStyle(model));
    const bounces =
      state.bounce === "all"
        ? this.bounces(state).map((b) => ({ name: BOUNCE_NAMES[b], colour: BOUNCE_COLOURS[b] ?? "", fill: true }))
        : [];
    this.keys.replaceChildren(legend([...models, ...bounces]));
  }

  /** Bounces of the main model that are told apart. */
  private bounces(state: State): Bounce[] {
    const main = mainModel(this.context.manifest, state)?.model ?? "";
    const labels = this.lobes.get(main)?.labels ?? [];
    return labels.length > 1 ? (labels as Bounce[]) : [];
  }

  private lines(state: State): Line[] {
    const main = mainModel(this.context.manifest, state)?.model ?? "";
    const lines: Line[] = [];
    const orders = this.lobes.get(main);
    if (state.bounce === "all" && orders) {
      for (const bounce of this.bounces(state)) {
        const y = orders.column(bounce, state.channel);
        lines.push({ x: this.angle, y, colour: BOUNCE_COLOURS[bounce] ?? "#888", width: 1, band: y });
      }
    }
    for (const [model, each] of this.lobes) {
      const { colour, dash } = modelStyle(model);
      lines.push({
        x: this.angle,
        y: each.column(state.bounce, state.channel),
        colour,
        dash,
        width: model === main ? 2.4 : 1.7,
      });
    }
    return lines;
  }

  table(state: State): Table {
    const names = [...this.lobes.keys()];
    const head = ["angle in the plane of incidence [degrees]"];
    for (const name of names)
      for (const label of this.lobes.get(name)?.labels ?? []) head.push(`${name}, ${label} bounces [1/sr]`);
    const rows = Array.from(this.angle, (angle, row) => [
      (angle * 180) / Math.PI,
      ...names.flatMap((name) => {
        const each = this.lobes.get(name);
        return each ? each.labels.map((label) => each.at(row, label as Bounce, state.channel)) : [];
      }),
    ]);
    return { name: "plane of incidence", head, rows };
  }
}
