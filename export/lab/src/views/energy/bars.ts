/** Shares of the light as one bar: reflected and transmitted by bounce, and what is left, together one. */

import type { Energy } from "../../engine/energy";
import type { Bounce, Channel } from "../../numbers/orders";
import { percent } from "../../numbers/format";
import { el } from "../../ui/dom";
import { BOUNCE_COLOURS, BOUNCE_NAMES, isLight } from "../../ui/palette";

export interface Share {
  name: string;
  value: number;
  colour: string;
  transmitted: boolean;
}

/** The shares of a bar in their order; the last is what is missing from one, negative where a model gives too much. */
export function shares(energy: Energy, channel: Channel, rest: string): Share[] {
  const list: Share[] = [];
  for (const [orders, transmitted] of [
    [energy.reflected, false],
    [energy.transmitted, true],
  ] as const) {
    for (const label of orders.labels) {
      const value = orders.at(0, label as Bounce, channel);
      if (transmitted && value === 0) continue;
      const name = `${transmitted ? "transmitted" : "reflected"}, ${BOUNCE_NAMES[label as Bounce]}`;
      list.push({ name, value, colour: BOUNCE_COLOURS[label] ?? "#56b4e9", transmitted });
    }
  }
  const sum = list.reduce((total, share) => total + share.value, 0);
  return [...list, { name: rest, value: 1 - sum, colour: "", transmitted: false }];
}

/** One bar with its sum. */
export function bar(title: string, list: readonly Share[]): HTMLElement {
  const total = list.slice(0, -1).reduce((sum, share) => sum + share.value, 0);
  const parts = list.map((share) => {
    const width = Math.max(0, share.value) / Math.max(1, total);
    const kind = share.colour === "" ? "rest" : share.transmitted ? "part through" : "part";
    const text = width > 0.085 ? percent(share.value) : "";
    const part = el("span", { class: kind, title: `${share.name}: ${percent(share.value)}` }, text);
    part.style.width = `${100 * width}%`;
    if (share.colour) part.style.backgroundColor = share.colour;
    if (isLight(share.colour)) part.classList.add("light");
    return part;
  });
  const said = list.map((share) => `${share.name} ${percent(share.value)}`).join(", ");
  return el(
    "div",
    { class: "bar", role: "img", "aria-label": `${title}: ${said}` },
    el("span", { class: "bar-name" }, title),
    el("span", { class: "bar-parts" }, ...parts),
    el("span", { class: "bar-sum", title: "Sum of all shares but the last" }, percent(total)),
  );
}

/** What the rest of a bar is. */
export function restName(material: string, lossless: boolean): string {
  return lossless || material === "dielectric" ? "lost by the model" : "absorbed, or lost by the model";
}
