/** What the lines of a chart are. */

import { el } from "./dom";

export interface Key {
  name: string;
  colour: string;
  dash?: number[];
  /** A filled square instead of a line. */
  fill?: boolean;
}

export function legend(keys: readonly Key[]): HTMLElement {
  return el("ul", { class: "legend" }, ...keys.map((key) => el("li", {}, sample(key), key.name)));
}

function sample(key: Key): SVGSVGElement {
  const ns = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(ns, "svg");
  svg.setAttribute("viewBox", "0 0 26 10");
  svg.setAttribute("aria-hidden", "true");
  const shape = document.createElementNS(ns, key.fill ? "rect" : "line");
  const given = key.fill
    ? { x: 6, y: 0, width: 14, height: 10, rx: 2, fill: key.colour }
    : {
        x1: 0,
        y1: 5,
        x2: 26,
        y2: 5,
        stroke: key.colour,
        "stroke-width": 2.5,
        "stroke-dasharray": (key.dash ?? []).join(" "),
      };
  for (const [name, value] of Object.entries(given)) shape.setAttribute(name, String(value));
  svg.append(shape);
  return svg;
}
