/** Where two models differ: the hemisphere as a disc of equal areas, colours the difference over the highest value. */

import type { State } from "../../app/state";
import { follow } from "../../engine/follow";
import { Latest } from "../../engine/latest";
import { incidence } from "../../engine/surface";
import { mirrored, packed } from "../../geometry/directions";
import { disc, onDisc, type Disc } from "../../geometry/disc";
import { percent } from "../../numbers/format";
import type { Orders } from "../../numbers/orders";
import { el, onResize, paint } from "../../ui/dom";
import { colourBar, raster } from "../../ui/heatmap";
import { diverging, modelStyle, themeColour } from "../../ui/palette";
import { card } from "../card";
import { mainModel, secondModel, type Context } from "../context";

const SIZE = 40;

interface Pair {
  first: Orders;
  second: Orders;
  discs: Disc[];
}

export class MapView {
  private readonly card = card("Difference of two models", "", "map");
  readonly element = this.card.element;
  readonly canvas = el("canvas", { role: "img", id: "map" });
  private readonly work: Latest<State>;
  private pair: Pair | null = null;

  constructor(private readonly context: Context) {
    this.card.body.append(this.canvas);
    this.work = new Latest((state, stale) => this.compute(state, stale), context.complain);
    onResize(this.card.body, () => this.redraw(context.store.state));
  }

  update(state: State): void {
    this.work.request(state);
  }

  private async compute(state: State, stale: () => boolean): Promise<void> {
    const { manifest, slow: engine } = this.context;
    const [a, b] = [mainModel(manifest, state), secondModel(manifest, state)];
    if (!a || !b) return;
    const side = incidence(state)[2] >= 0 ? 1 : -1;
    const discs = [disc(SIZE, side)];
    if (state.material === "dielectric") discs.push(disc(SIZE, side > 0 ? -1 : 1));
    const wo = packed(discs.flatMap((d) => d.directions));
    await follow({ engine, manifest, state, entries: a === b ? [a] : [a, b], wo, pass: 4 }, stale, (now) => {
      const [first, second] = [now.lobes.get(a.model ?? ""), now.lobes.get(b.model ?? "")];
      if (first && second) this.pair = { first, second, discs };
      this.redraw(this.context.store.state);
    });
  }

  redraw(state: State): void {
    const { manifest } = this.context;
    const [a, b] = [mainModel(manifest, state), secondModel(manifest, state)];
    if (!this.pair || !a || !b) return;
    const [nameA, nameB] = [modelStyle(a.model ?? "").name, modelStyle(b.model ?? "").name];
    this.card.title.textContent = `${nameA} − ${nameB}`;
    const found = difference(this.pair, state);
    this.card.note.textContent =
      found === null
        ? "One of the two does not tell these bounces apart."
        : `RMS over the sphere ${percent(found.rms)} of that of ${nameB}; orange: the first is brighter`;
    paint(this.canvas, (context, width, height) => found && this.draw(context, width, height, found, state));
    this.canvas.setAttribute("aria-label", `Difference map, ${this.card.note.textContent}`);
  }

  private draw(
    context: CanvasRenderingContext2D,
    width: number,
    height: number,
    found: { values: Float64Array; most: number },
    state: State,
  ): void {
    const discs = this.pair?.discs ?? [];
    const edge = Math.min((width - 16 * (discs.length + 1)) / discs.length, height - 58);
    const left = (width - edge * discs.length - 16 * (discs.length - 1)) / 2;
    let start = 0;
    discs.forEach((each, i) => {
      const field = new Float64Array(each.size ** 2).fill(NaN);
      each.cells.forEach((cell, k) => (field[cell] = (found.values[start + k] ?? 0) / found.most));
      start += each.cells.length;
      const x = left + i * (edge + 16);
      context.save();
      context.beginPath();
      context.arc(x + edge / 2, 8 + edge / 2, edge / 2 - edge / each.size, 0, 2 * Math.PI);
      context.clip();
      context.imageSmoothingEnabled = true;
      context.drawImage(raster(field, each.size, each.size, diverging), x, 8, edge, edge);
      context.restore();
      this.marks(context, x, edge, state, i === 0);
    });
    const bar = {
      x: width / 2 - Math.min(120, width / 3),
      y: height - 30,
      width: Math.min(240, (2 * width) / 3),
      height: 8,
    };
    const most = percent(found.most);
    colourBar(
      context,
      bar,
      (t) => diverging(2 * t - 1),
      [`−${most}`, "of the highest value", `+${most}`],
      themeColour("--soft"),
    );
  }

  private marks(context: CanvasRenderingContext2D, x: number, edge: number, state: State, own: boolean): void {
    const wi = incidence(state);
    const [cx, cy] = [x + edge / 2, 8 + edge / 2];
    context.strokeStyle = themeColour("--line");
    context.beginPath();
    context.arc(cx, cy, edge / 2 - 1, 0, 2 * Math.PI);
    context.stroke();
    const mark = own ? [wi, mirrored(wi)] : [];
    mark.forEach((d, i) => {
      const p = onDisc(d);
      context.beginPath();
      context.arc(cx + (p.x * edge) / 2, cy - (p.y * edge) / 2, i === 0 ? 5 : 3.5, 0, 2 * Math.PI);
      context.strokeStyle = context.fillStyle = themeColour("--light");
      context.lineWidth = 2;
      if (i === 0) context.fill();
      else context.stroke();
    });
    context.fillStyle = themeColour("--soft");
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "top";
    if (state.material === "dielectric") context.fillText(own ? "reflected" : "transmitted", x, 2);
  }
}

/** Values of the difference, the scale of the colours, the RMS; null where a model does not tell the bounces apart. */
function difference(pair: Pair, state: State): { values: Float64Array; most: number; rms: number } | null {
  if (!pair.first.has(state.bounce) || !pair.second.has(state.bounce)) return null;
  const a = pair.first.column(state.bounce, state.channel);
  const b = pair.second.column(state.bounce, state.channel);
  const peak = Math.max(...b, 1e-12);
  const values = a.map((x, i) => (x - (b[i] ?? 0)) / peak);
  const squares = (list: Float64Array): number => list.reduce((sum, x) => sum + x * x, 0);
  const rms = Math.sqrt(squares(values) / Math.max(squares(b.map((x) => x / peak)), 1e-30));
  // Round steps, so that colours do not change with every frame.
  const largest = Math.max(...values.map(Math.abs), 1e-4);
  const most = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1].find((m) => m >= largest) ?? 1;
  return { values, most, rms };
}
