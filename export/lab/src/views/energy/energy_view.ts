/** The second view: where the light goes, as bars of every model, over the angle, and on spheres. */

import type { State } from "../../app/state";
import { MIRROR } from "../../files/manifest";
import type { Bounce } from "../../numbers/orders";
import { el } from "../../ui/dom";
import { legend } from "../../ui/legend";
import { BOUNCE_COLOURS, BOUNCE_NAMES, modelStyle } from "../../ui/palette";
import { card } from "../card";
import type { Context, Table, View } from "../context";
import { bar, restName, shares } from "./bars";
import { LiveEnergy, type Energies } from "./live_energy";
import { SpheresView } from "./spheres_view";

export class EnergyView implements View {
  private readonly bars = card("Where the light goes", "", "budget");
  private readonly spheres: SpheresView;
  private readonly live: LiveEnergy;
  private energies: Energies | null = null;
  private readonly perfect = el("button", { type: "button", class: "quiet", onclick: () => this.lossless() });
  readonly element: HTMLElement;

  constructor(private readonly context: Context) {
    this.spheres = new SpheresView(context);
    this.bars.element.append(this.perfect);
    this.live = new LiveEnergy(context, (now) => {
      this.energies = now;
      this.redraw(context.store.state);
    });
    this.element = el("div", { class: "view energy" }, this.bars.element, this.spheres.element);
  }

  private lossless(): void {
    this.context.store.set(this.context.store.state.material === "conductor" ? { metal: MIRROR } : { albedo: 1 });
  }

  update(state: State): void {
    const all = this.context.manifest.models(state).filter((m) => m.reason === null);
    this.live.request(
      state,
      all.map((m) => m.entry),
    );
    this.spheres.update(state);
  }

  redraw(state: State): void {
    // Glass absorbs nothing anyway.
    this.perfect.hidden = state.material === "dielectric";
    this.perfect.textContent = `Let nothing be absorbed (${state.material === "conductor" ? "F = 1" : "albedo 1"})`;
    const rest = restName(state.material, state.material === "conductor" ? state.metal === MIRROR : state.albedo === 1);
    const energies = this.energies;
    const exact = this.context.manifest
      .models(state)
      .find(({ entry }) => entry.exact && energies?.of.has(entry.model ?? ""));
    const averaged = `; the exact model: ${exact?.entry.orders?.length} bounces, ${energies?.passes ?? 0} paths in each`;
    this.bars.note.textContent =
      `Share of the light from θi = ${state.theta.toFixed(1)}° that leaves after each bounce [%]; quadrature over ` +
      `${energies?.nodes ?? 0} directions${exact ? averaged : ""}`;
    const found = [...(energies?.of ?? [])];
    const bars = found.map(([model, energy]) => bar(modelStyle(model).name, shares(energy, state.channel, rest)));
    const labels = new Set(found.flatMap(([, energy]) => [...energy.reflected.labels]));
    // In the order in which light leaves; "2 or more" belongs to other models.
    const keys = [...labels]
      .sort((a, b) => Number(a === "2+") - Number(b === "2+") || a.localeCompare(b))
      .map((label) => ({ name: BOUNCE_NAMES[label as Bounce], colour: BOUNCE_COLOURS[label] ?? "#888", fill: true }));
    const striped =
      state.material === "dielectric"
        ? el("p", { class: "note" }, "Striped: transmitted. Hatched grey: ", rest, ".")
        : el("p", { class: "note" }, "Hatched grey: ", rest, ".");
    this.bars.body.replaceChildren(el("div", { class: "bars" }, ...bars), legend(keys), striped);
    this.spheres.redraw(state);
  }

  hide(): void {
    this.spheres.stop();
  }

  tables(): Table[] {
    const channel = this.context.store.state.channel;
    const rows = [...(this.energies?.of ?? [])].flatMap(([model, energy]) =>
      energy.reflected.labels.map((label) => [
        model,
        label,
        energy.reflected.at(0, label as Bounce, channel),
        energy.transmitted.at(0, label as Bounce, channel),
      ]),
    );
    return [{ name: "energies", head: ["model", "bounces", "reflected [1]", "transmitted [1]"], rows }];
  }

  canvases(): HTMLCanvasElement[] {
    return [...this.spheres.canvases];
  }
}
