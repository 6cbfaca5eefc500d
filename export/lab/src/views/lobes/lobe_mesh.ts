/** One lobe as surfaces: the value is the distance from the point that is lit.
 *
 * All bounces are drawn as shells: the innermost is one bounce, each further one adds the next; so the thickness of a
 * shell is what that bounce adds.
 */

import * as THREE from "three";
import type { Scale, Tint } from "../../app/state";
import type { LobeGrid } from "../../geometry/lobe_grid";
import type { Bounce, Channel, Orders } from "../../numbers/orders";
import { BOUNCE_COLOURS } from "../../ui/palette";
import { DECADES } from "../../ui/polar_chart";
import { Clear } from "./clear";

export interface Shape {
  bounce: Bounce;
  channel: Channel;
  scale: Scale;
  /** Value that is one unit long [1/sr]. */
  top: number;
  tint: Tint;
}

const SHELLS = 4;

type Mesh = THREE.Mesh<THREE.BufferGeometry, THREE.MeshPhongMaterial | Clear>;

export class LobeMesh {
  readonly group = new THREE.Group();
  private readonly shells: Mesh[] = Array.from({ length: SHELLS }, (_, i) => {
    const material = i === 0 ? new THREE.MeshPhongMaterial({ specular: 0x333333, shininess: 24 }) : new Clear();
    const mesh = new THREE.Mesh(new THREE.BufferGeometry(), material);
    mesh.frustumCulled = false;
    mesh.renderOrder = i;
    // A program that is compiled for a geometry without normals shades flatly ever after.
    mesh.visible = false;
    this.group.add(mesh);
    return mesh;
  });

  update(grid: LobeGrid, orders: Orders, shape: Shape): void {
    const layered = shape.bounce === "all" && (shape.tint === "bounce" || orders.channels === 1);
    const count = layered ? Math.min(SHELLS, orders.labels.length) : 1;
    let values: Float64Array = new Float64Array(orders.rows);
    this.shells.forEach((mesh, i) => {
      mesh.visible = i < count;
      if (i >= count) return;
      const name = layered ? (orders.labels[i] as Bounce) : shape.bounce;
      const more = orders.column(name, shape.channel);
      values = layered ? values.map((v, row) => v + (more[row] ?? 0)) : more;
      this.form(mesh, grid, values, shape);
      if (shape.tint === "colour" && orders.channels === 3) paintOwn(mesh, orders, shape.bounce);
      else paintFlat(mesh, BOUNCE_COLOURS[name] ?? "#0072b2");
    });
  }

  private form(mesh: Mesh, grid: LobeGrid, values: Float64Array, shape: Shape): void {
    const positions = new Float32Array(3 * grid.directions.length);
    grid.directions.forEach((d, i) => {
      const r = length(values[i] ?? 0, shape);
      positions.set([d[0] * r, d[1] * r, d[2] * r], 3 * i);
    });
    const geometry = mesh.geometry;
    if (geometry.index?.count !== grid.triangles.length)
      geometry.setIndex(new THREE.BufferAttribute(grid.triangles, 1));
    put(geometry, "position", positions);
    geometry.computeVertexNormals();
  }
}

/** Distance for a value: in proportion, or the decades below `top`. */
export function length(value: number, shape: Pick<Shape, "scale" | "top">): number {
  if (!(value > 0)) return 0;
  if (shape.scale === "linear") return value / shape.top;
  return Math.max(0, 1 + Math.log10(value / shape.top) / DECADES);
}

function paintFlat({ material }: Mesh, colour: string): void {
  if (material instanceof Clear) material.colour.set(colour);
  else {
    material.color.set(colour);
    setVertexColours(material, false);
  }
}

/** The colour of the light itself, as bright as it can be in each direction. */
function paintOwn({ geometry, material }: Mesh, orders: Orders, bounce: Bounce): void {
  if (material instanceof Clear) return;
  const colours = new Float32Array(3 * orders.rows);
  for (let row = 0; row < orders.rows; row++) {
    const rgb = (["R", "G", "B"] as const).map((c) => Math.max(0, orders.at(row, bounce, c)));
    const most = Math.max(...rgb, 1e-12);
    colours.set(
      rgb.map((x) => (0.9 * x) / most),
      3 * row,
    );
  }
  material.color.set("#ffffff");
  put(geometry, "color", colours);
  setVertexColours(material, true);
}

function setVertexColours(material: THREE.Material, on: boolean): void {
  if (material.vertexColors !== on) material.needsUpdate = true;
  material.vertexColors = on;
}

function put(geometry: THREE.BufferGeometry, name: string, data: Float32Array): void {
  const old = geometry.getAttribute(name) as THREE.BufferAttribute | undefined;
  if (old && old.array.length === data.length) {
    old.array.set(data);
    old.needsUpdate = true;
  } else geometry.setAttribute(name, new THREE.BufferAttribute(data, 3));
}
