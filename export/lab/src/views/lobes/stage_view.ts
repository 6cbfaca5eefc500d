/** The lobe in 3-D: meshes on both sides of the surface, the handles, and a line of text. */

import type { State } from "../../app/state";
import { follow } from "../../engine/follow";
import { Latest } from "../../engine/latest";
import { exit, incidence } from "../../engine/surface";
import type { Entry } from "../../files/manifest";
import { angles, dot, mirrored, packed, type Vec3 } from "../../geometry/directions";
import { lobeGrid, type LobeGrid } from "../../geometry/lobe_grid";
import { short } from "../../numbers/format";
import type { Orders } from "../../numbers/orders";
import { el, onResize } from "../../ui/dom";
import { BOUNCE_NAMES, modelStyle } from "../../ui/palette";
import { mainModel, type Context } from "../context";
import { Handles } from "./handles";
import { LobeMesh, type Shape } from "./lobe_mesh";
import { Stage } from "./scene";

const [RINGS, SPOKES] = [28, 48];

const KEYS =
  "The lobe in 3-D. Arrow keys turn the light, with Shift the direction of the numbers; A, D, W, S turn the camera, + and − move it";

interface Side {
  grid: LobeGrid;
  orders: Orders;
}

export class StageView {
  readonly canvas = el("canvas", { tabindex: 0, role: "img", id: "stage", "aria-label": KEYS });
  readonly text = el("p", { class: "over", role: "status", "aria-live": "polite" });
  readonly element = el("div", { class: "stage" }, this.canvas, this.text);
  readonly stage = new Stage(this.canvas);
  private readonly lobes = [new LobeMesh(), new LobeMesh()] as const;
  readonly handles: Handles;
  private readonly work: Latest<State>;
  private sides: Side[] = [];
  /** Where the lower lobe was highest: its grid is dense there next time. */
  private below: Vec3 | null = null;
  private status = "";
  private both = false;
  /** Answers drawn so far. */
  updates = 0;

  constructor(private readonly context: Context) {
    const { store } = context;
    for (const { group } of this.lobes) this.stage.scene.add(group);
    const inDegrees = (d: Vec3): { theta: number; phi: number } => {
      const { theta, phi } = angles(d);
      return { theta: round((theta * 180) / Math.PI), phi: round((phi * 180) / Math.PI) };
    };
    this.handles = new Handles(
      this.stage,
      (d) => store.set(inDegrees(d)),
      (d) => store.set({ outTheta: inDegrees(d).theta, outPhi: inDegrees(d).phi }),
    );
    this.work = new Latest((state, stale) => this.compute(state, stale), context.complain);
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    onResize(this.element, () => this.stage.resize());
  }

  update(state: State): void {
    this.handles.place(incidence(state), exit(state));
    const both = state.material === "dielectric";
    if (both !== this.both) this.stage.look(both);
    this.both = both;
    this.work.request(state);
  }

  restyle(): void {
    this.stage.restyle();
    this.handles.restyle();
  }

  /** Draws anew what is known: another bounce, scale or theme needs no evaluation. */
  redraw(state: State): void {
    if (this.sides.length === 0) return;
    const top = Math.max(1e-9, ...this.sides.map((s) => Math.max(...s.orders.column(state.bounce, state.channel), 0)));
    const shape: Shape = { ...state, top };
    this.lobes.forEach((lobe, i) => {
      const side = this.sides[i];
      lobe.group.visible = side !== undefined;
      if (side) lobe.update(side.grid, side.orders, shape);
    });
    const scale = state.scale === "log" ? "logarithmic, four decades" : "linear";
    const highest = `highest value ${short(top)} /sr, ${scale}`;
    this.text.textContent = `${this.status} · ${BOUNCE_NAMES[state.bounce]} · ${highest}`;
    this.stage.draw();
  }

  private async compute(state: State, stale: () => boolean): Promise<void> {
    const { manifest } = this.context;
    const entry = mainModel(manifest, state);
    if (!entry) throw new Error("There is no model for this surface.");
    // A lobe on the far side is sought first with a few paths: its grid is then dense where it is highest.
    const sought = this.below;
    if (state.material === "dielectric") await this.trace(entry, { ...state, paths: 4 }, stale);
    if (stale()) return;
    const found = this.below && sought && dot(this.below, sought) > 0.999;
    if (state.material !== "dielectric" || entry.random || !found) await this.trace(entry, state, stale);
  }

  private async trace(entry: Entry, state: State, stale: () => boolean): Promise<void> {
    const { manifest, fast: engine } = this.context;
    const grids = this.grids(state);
    const wo = packed(grids.flatMap((grid) => grid.directions));
    const task = { engine, manifest, state, entries: [entry], wo, pass: 4 };
    await follow(task, stale, (now) => {
      const orders = now.lobes.get(entry.model ?? "");
      if (!orders) return;
      let start = 0;
      this.sides = grids.map((grid) => {
        const side = { grid, orders: orders.slice(start, grid.directions.length) };
        start += grid.directions.length;
        return side;
      });
      this.below = highest(this.sides[1]);
      this.status = modelStyle(entry.model ?? "").name + (entry.random ? `, mean of ${now.paths} paths` : "");
      this.updates++;
      this.redraw(this.context.store.state);
    });
  }

  /** The side of the light, and for glass the other one. */
  private grids(state: State): LobeGrid[] {
    const wi = incidence(state);
    const side = wi[2] >= 0 ? 1 : -1;
    const alpha = Math.min(state.alpha, state.alphaY);
    const own = lobeGrid(mirrored(wi), side, alpha, RINGS, SPOKES);
    if (state.material !== "dielectric") return [own];
    const straight: Vec3 = [-wi[0], -wi[1], -wi[2]];
    const pole = this.below && this.below[2] * wi[2] < 0 ? this.below : straight;
    return [own, lobeGrid(pole, side > 0 ? -1 : 1, alpha, RINGS, SPOKES)];
  }

  /** Arrow keys turn the light, with Shift the direction of the numbers; A, D, W and S turn the camera, + and − move it. */
  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const camera: Record<string, [number, number, number]> = {
      a: [-0.1, 0, 1],
      d: [0.1, 0, 1],
      w: [0, 0.1, 1],
      s: [0, -0.1, 1],
      "+": [0, 0, 0.9],
      "-": [0, 0, 1 / 0.9],
    };
    const turn = camera[event.key.toLowerCase()];
    if (turn) {
      event.preventDefault();
      this.stage.turn(...turn);
      return;
    }
    const step: Record<string, [number, number]> = {
      ArrowUp: [-1, 0],
      ArrowDown: [1, 0],
      ArrowLeft: [0, -2],
      ArrowRight: [0, 2],
    };
    const [dTheta, dPhi] = step[event.key] ?? [0, 0];
    if (dTheta === 0 && dPhi === 0) return;
    event.preventDefault();
    const { store } = this.context;
    const s = store.state;
    const [theta, phi] = event.shiftKey ? [s.outTheta, s.outPhi] : [s.theta, s.phi];
    const next = { theta: Math.max(0, Math.min(180, theta + dTheta)), phi: ((phi + dPhi + 540) % 360) - 180 };
    store.set(event.shiftKey ? { outTheta: next.theta, outPhi: next.phi } : next);
  }
}

function highest(side: Side | undefined): Vec3 | null {
  if (!side) return null;
  const values = side.orders.column("all", "Y");
  return side.grid.directions[values.indexOf(Math.max(...values))] ?? null;
}

function round(x: number): number {
  return Math.round(10 * x) / 10;
}
