/** The fourth view: the graphs of the source documents, live. */

import type { State } from "../../app/state";
import { Latest } from "../../engine/latest";
import { el, onResize } from "../../ui/dom";
import { legend } from "../../ui/legend";
import { lineChart } from "../../ui/line_chart";
import { card } from "../card";
import type { Context, Table, View } from "../context";
import { FieldsCard } from "./fields_card";
import { capCurves, maskingCurve } from "./graph_data";

const CAPS = [
  { name: "spherical cap (Dupuy, Benyoub 2023)", colour: "#009e73", dash: [7, 4] },
  { name: "bounded cap (Tokuyoshi, Eto 2023)", colour: "#d55e00", dash: [] },
  { name: "reflections on the horizon", colour: "#e69f00", dash: [2, 3] },
];
const MASKING = [
  { key: "ggx", name: "GGX", colour: "#0072b2", dash: [] },
  { key: "beckmann", name: "Beckmann", colour: "#d55e00", dash: [7, 3] },
  { key: "gtr", name: "GTR", colour: "#009e73", dash: [2, 3] },
] as const;
const POINTS = 361;

export class GraphsView implements View {
  private readonly caps = card("Bounded visible normals", "", "graph");
  private readonly masking = card("Masking on the full sphere", "", "graph");
  private readonly fields: FieldsCard;
  private readonly capsCanvas = el("canvas", {
    role: "img",
    id: "caps",
    "aria-label": "Caps of visible normals against longitude",
  });
  private readonly maskingCanvas = el("canvas", {
    role: "img",
    id: "masking",
    "aria-label": "G1 against the angle from the normal",
  });
  readonly element: HTMLElement;
  private readonly work: Latest<State>;
  private curves: {
    caps: Awaited<ReturnType<typeof capCurves>>;
    masking: Awaited<ReturnType<typeof maskingCurve>>[];
  } | null = null;

  constructor(private readonly context: Context) {
    this.fields = new FieldsCard(context);
    this.caps.body.append(this.capsCanvas, legend(CAPS));
    this.masking.body.append(this.maskingCanvas, legend(MASKING.map((m) => ({ ...m, dash: [...m.dash] }))));
    this.element = el("div", { class: "view graphs" }, this.caps.element, this.masking.element, this.fields.element);
    this.work = new Latest((state, stale) => this.compute(state, stale), context.complain);
    onResize(this.caps.body, () => this.redraw(context.store.state));
  }

  update(state: State): void {
    this.work.request(state);
    this.fields.update();
  }

  private async compute(state: State, stale: () => boolean): Promise<void> {
    const { manifest, fast } = this.context;
    const caps = await capCurves(fast, manifest, state, POINTS);
    const masking = [];
    for (const { key } of MASKING) masking.push(await maskingCurve(fast, manifest, state, key, POINTS));
    if (stale()) return;
    this.curves = { caps, masking };
    this.redraw(this.context.store.state);
  }

  redraw(state: State): void {
    this.fields.redraw();
    if (!this.curves) return;
    const { caps, masking } = this.curves;
    const alpha = state.round ? `α = ${state.alpha}` : `α = ${state.alpha} × ${state.alphaY}`;
    this.caps.note.textContent =
      `Lowest z of a reflection in the stretched frame [1] against its longitude φ [°], GGX, ${alpha}, ` +
      `θi = ${state.theta.toFixed(1)}°, φi = ${state.phi.toFixed(1)}°. Nothing between the caps is drawn in vain.`;
    const degrees = (x: Float32Array): Float32Array => x.map((v) => (v * 180) / Math.PI);
    const x = degrees(caps.phi);
    const yRange = [-1.02, Math.max(0.1, ...caps.delta[2]) + 0.05] as const;
    const axes = {
      xLabel: "longitude of the reflection φ [°]",
      yLabel: "δz [1]",
      xRange: [-180, 180] as const,
      xTicks: [-180, -90, 0, 90, 180],
    };
    const curves = caps.delta.map((y, i) => ({
      x,
      y,
      colour: CAPS[i]?.colour ?? "",
      dash: CAPS[i]?.dash ?? [],
      width: 2.2,
    }));
    lineChart(this.capsCanvas, { ...axes, yRange, zero: true }, curves);
    this.masking.note.textContent = `G1 [1] against θ [°]; above one from below. ${alpha}, GTR: γ = ${state.gamma}, round.`;
    const lines = masking.map(({ theta, G1 }, i) => ({
      x: degrees(theta),
      y: G1,
      colour: MASKING[i]?.colour ?? "",
      dash: [...(MASKING[i]?.dash ?? [])],
      width: 2.2,
    }));
    const log = {
      xLabel: "θ from the normal [°]",
      yLabel: "G1 [1]",
      xRange: [0, 180] as const,
      xTicks: [0, 45, 90, 135, 180],
      yRange: [0.05, 300] as const,
      log: true,
    };
    lineChart(this.maskingCanvas, log, lines);
  }

  tables(): Table[] {
    if (!this.curves) return [];
    const { caps, masking } = this.curves;
    const first = Array.from(caps.phi, (phi, i) => [phi, ...caps.delta.map((d) => d[i] ?? NaN)]);
    const second = Array.from(masking[0]?.theta ?? [], (theta, i) => [theta, ...masking.map((m) => m.G1[i] ?? NaN)]);
    return [
      { name: "caps", head: ["phi [rad]", "spherical cap [1]", "bounded cap [1]", "horizon [1]"], rows: first },
      { name: "masking", head: ["theta [rad]", "GGX G1 [1]", "Beckmann G1 [1]", "GTR G1 [1]"], rows: second },
    ];
  }

  canvases(): HTMLCanvasElement[] {
    return [this.capsCanvas, this.maskingCanvas, ...this.fields.canvases];
  }
}
