/** One lobe as a surface: the value is the distance from the point that is lit. */

import * as THREE from "three";
import type { Scale } from "../../app/state";
import type { LobeGrid } from "../../geometry/lobe_grid";
import type { Bounce, Channel, Orders } from "../../numbers/orders";
import { DECADES } from "../../ui/polar_chart";
import { BOUNCE_COLOURS, hexToRgb } from "../../ui/palette";

export interface Shape {
  bounce: Bounce;
  channel: Channel;
  scale: Scale;
  /** Value that is one unit long [1/sr]. */
  top: number;
  /** Colours by the share of each bounce, or by the light's own colour. */
  tint: "bounce" | "colour";
}

export class LobeMesh {
  readonly mesh: THREE.Mesh<THREE.BufferGeometry, THREE.MeshStandardMaterial>;

  constructor() {
    const material = new THREE.MeshStandardMaterial({
      vertexColors: true,
      side: THREE.DoubleSide,
      roughness: 0.5,
      metalness: 0.05,
    });
    this.mesh = new THREE.Mesh(new THREE.BufferGeometry(), material);
    this.mesh.frustumCulled = false;
  }

  update(grid: LobeGrid, orders: Orders, shape: Shape): void {
    const n = grid.directions.length;
    const positions = new Float32Array(3 * n);
    const colours = new Float32Array(3 * n);
    const colour = new THREE.Color();
    for (let i = 0; i < n; i++) {
      const d = grid.directions[i] ?? [0, 0, 1];
      const r = length(orders.at(i, shape.bounce, shape.channel), shape);
      positions.set([d[0] * r, d[1] * r, d[2] * r], 3 * i);
      colour.setRGB(...tinted(orders, i, shape), THREE.SRGBColorSpace);
      colours.set([colour.r, colour.g, colour.b], 3 * i);
    }
    const geometry = this.mesh.geometry;
    if (geometry.index?.count !== grid.triangles.length) geometry.setIndex(new THREE.BufferAttribute(grid.triangles, 1));
    put(geometry, "position", positions);
    put(geometry, "color", colours);
    geometry.computeVertexNormals();
  }
}

/** Distance for a value: in proportion, or the decades below `top`. */
export function length(value: number, shape: Pick<Shape, "scale" | "top">): number {
  if (!(value > 0)) return 0;
  if (shape.scale === "linear") return value / shape.top;
  return Math.max(0, 1 + Math.log10(value / shape.top) / DECADES);
}

/** sRGB in [0, 1] of a row. */
function tinted(orders: Orders, row: number, shape: Shape): [number, number, number] {
  if (shape.tint === "colour" && orders.channels === 3) {
    const rgb = (["R", "G", "B"] as const).map((c) => orders.at(row, shape.bounce, c));
    const most = Math.max(...rgb, 1e-12);
    return rgb.map((x) => Math.pow(Math.max(x, 0) / most, 1 / 2.2) * 0.95) as [number, number, number];
  }
  if (shape.bounce !== "all") return bounceColour(shape.bounce);
  const mixed: [number, number, number] = [0, 0, 0];
  const total = orders.at(row, "all", shape.channel) || 1;
  for (const name of orders.labels) {
    const share = orders.at(row, name as Bounce, shape.channel) / total;
    bounceColour(name).forEach((x, c) => (mixed[c] = (mixed[c] ?? 0) + share * x));
  }
  return mixed.map((x) => Math.max(0, Math.min(1, x))) as [number, number, number];
}

function bounceColour(name: string): [number, number, number] {
  return hexToRgb(BOUNCE_COLOURS[name] ?? "#56b4e9").map((x) => x / 255) as [number, number, number];
}

function put(geometry: THREE.BufferGeometry, name: string, data: Float32Array): void {
  const old = geometry.getAttribute(name) as THREE.BufferAttribute | undefined;
  if (old && old.array.length === data.length) {
    old.array.set(data);
    old.needsUpdate = true;
  } else geometry.setAttribute(name, new THREE.BufferAttribute(data, 3));
}
