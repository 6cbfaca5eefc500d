/** The numbers: the value at the two directions, and the energies, bounce by bounce. */

import type { State } from "../../app/state";
import type { Energy } from "../../engine/energy";
import { follow, type Followed } from "../../engine/follow";
import { Latest } from "../../engine/latest";
import { exit } from "../../engine/surface";
import { MIRROR } from "../../files/manifest";
import { packed } from "../../geometry/directions";
import { precise } from "../../numbers/format";
import type { Bounce, Orders } from "../../numbers/orders";
import { el } from "../../ui/dom";
import { BOUNCE_COLOURS, BOUNCE_NAMES, modelStyle } from "../../ui/palette";
import { card } from "../card";
import { mainModel, shown, type Context, type Table } from "../context";
import { bar, restName, shares } from "../energy/bars";
import { LiveEnergy, type Energies } from "../energy/live_energy";

export class NumbersView {
  private readonly card = card("Numbers", "", "numbers");
  readonly element = this.card.element;
  private readonly tableBody = el("tbody");
  private readonly bars = el("div", { class: "bars" });
  private readonly value: Latest<State>;
  private readonly live: LiveEnergy;
  private followed: Followed | null = null;
  private energies: Energies | null = null;

  constructor(private readonly context: Context) {
    const heads = ["bounces", "f · |cos θo| [1/sr]", "reflected E [1]", "transmitted E [1]"];
    const head = el("tr", {}, ...heads.map((text) => el("th", { scope: "col" }, text)));
    this.card.body.append(el("table", { id: "numbers" }, el("thead", {}, head), this.tableBody), this.bars);
    this.value = new Latest((state, stale) => this.compute(state, stale), context.complain);
    this.live = new LiveEnergy(context, (now) => {
      this.energies = now;
      this.redraw(context.store.state);
    });
  }

  update(state: State): void {
    const { manifest } = this.context;
    this.followed = null;
    if (this.energies) this.energies.settled = false;
    this.value.request(state);
    const main = mainModel(manifest, state);
    this.live.request(state, shown(manifest, state, [...state.models, main?.model ?? ""]));
  }

  private async compute(state: State, stale: () => boolean): Promise<void> {
    const { manifest, fast: engine } = this.context;
    const entry = mainModel(manifest, state);
    if (!entry) return;
    const task = { engine, manifest, state, entries: [entry], wo: packed([exit(state)]), pass: 64 };
    await follow(task, stale, (now) => {
      this.followed = now;
      this.redraw(this.context.store.state);
    });
  }

  /** Everything that is shown, with all digits; null until it has settled. */
  settled(state: State): { model: string; value: Orders; energy: Energy } | null {
    const model = mainModel(this.context.manifest, state)?.model ?? "";
    const [value, energy] = [this.followed?.lobes.get(model), this.energies?.of.get(model)];
    return this.followed?.done && this.energies?.settled && value && energy ? { model, value, energy } : null;
  }

  redraw(state: State): void {
    const entry = mainModel(this.context.manifest, state);
    const model = entry?.model ?? "";
    const value = this.followed?.lobes.get(model);
    const energy = this.energies?.of.get(model);
    const channel =
      state.material === "dielectric" ? "" : `, channel ${state.channel === "Y" ? "luminance" : state.channel}`;
    this.card.note.textContent =
      `${modelStyle(model).name}, i (${state.theta.toFixed(1)}°, ${state.phi.toFixed(1)}°), ` +
      `o (${state.outTheta.toFixed(1)}°, ${state.outPhi.toFixed(1)}°)${channel}` +
      (entry?.random && value ? `, mean of ${this.followed?.paths} paths` : "");
    if (value) this.tableBody.replaceChildren(...this.rows(value, energy ?? null, state));
    this.bars.replaceChildren(...this.allBars(state));
  }

  private rows(value: Orders, energy: Energy | null, state: State): HTMLElement[] {
    const names: Bounce[] = [...(value.labels as Bounce[]), "all"];
    return names.map((bounce) => {
      const of = (orders: Orders | undefined): string => precise(orders ? orders.at(0, bounce, state.channel) : NaN);
      const swatch = el("span", { class: "swatch" });
      swatch.style.backgroundColor = BOUNCE_COLOURS[bounce] ?? "transparent";
      const cells = [of(value), of(energy?.reflected), state.material === "dielectric" ? of(energy?.transmitted) : "–"];
      const head = el("th", { scope: "row" }, swatch, BOUNCE_NAMES[bounce]);
      return el("tr", { "data-bounce": bounce }, head, ...cells.map((text) => el("td", {}, text)));
    });
  }

  private allBars(state: State): HTMLElement[] {
    const lossless = state.material === "conductor" ? state.metal === MIRROR : state.albedo === 1;
    const rest = restName(state.material, lossless);
    return [...(this.energies?.of ?? [])].map(([model, energy]) =>
      bar(modelStyle(model).name, shares(energy, state.channel, rest)),
    );
  }

  table(state: State): Table {
    const rows: (string | number)[][] = [];
    for (const [model, energy] of this.energies?.of ?? []) {
      for (const label of energy.reflected.labels as Bounce[]) {
        rows.push([
          model,
          label,
          energy.reflected.at(0, label, state.channel),
          energy.transmitted.at(0, label, state.channel),
        ]);
      }
    }
    return { name: "energies", head: ["model", "bounces", "reflected [1]", "transmitted [1]"], rows };
  }
}
