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

export interface Shape {
  bounce: Bounce;
  channel: Channel;
  scale: Scale;
  /** Value that is one unit long [1/sr]. */
  top: number;
  tint: Tint;
}

const SHELLS = 4;

type Mesh = THREE.Mesh<THREE.BufferGeometry, THREE.MeshStandardMaterial>;

export class LobeMesh {
  readonly group = new THREE.Group();
  private readonly shells: Mesh[] = Array.from({ length: SHELLS }, (_, i) => {
    const material = i === 0 ? new THREE.MeshStandardMaterial({ roughness: 0.42 }) : glassy();
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

/** Clear where it is seen from the front, coloured towards its rim: outer shells let the inner ones be seen. */
function glassy(): THREE.MeshStandardMaterial {
  const material = new THREE.MeshStandardMaterial({ roughness: 1, transparent: true, depthWrite: false });
  material.onBeforeCompile = (shader) => {
    const rim = "diffuseColor.a *= mix(0.2, 0.95, pow(1.0 - abs(dot(normalize(vViewPosition), normal)), 1.7));";
    shader.fragmentShader = shader.fragmentShader.replace(
      "#include <opaque_fragment>",
      `${rim}\n#include <opaque_fragment>`,
    );
  };
  return material;
}

/** Distance for a value: in proportion, or the decades below `top`. */
export function length(value: number, shape: Pick<Shape, "scale" | "top">): number {
  if (!(value > 0)) return 0;
  if (shape.scale === "linear") return value / shape.top;
  return Math.max(0, 1 + Math.log10(value / shape.top) / DECADES);
}

/** The core is lit; what is clear shines of itself, so that its colour is that of the legend. */
function paintFlat(mesh: Mesh, colour: string): void {
  const { material } = mesh;
  material.color.set(material.transparent ? "#000000" : colour);
  material.emissive.set(material.transparent ? colour : "#000000");
  setVertexColours(mesh, false);
}

/** The colour of the light itself, as bright as it can be in each direction. */
function paintOwn(mesh: Mesh, orders: Orders, bounce: Bounce): void {
  const colours = new Float32Array(3 * orders.rows);
  for (let row = 0; row < orders.rows; row++) {
    const rgb = (["R", "G", "B"] as const).map((c) => Math.max(0, orders.at(row, bounce, c)));
    const most = Math.max(...rgb, 1e-12);
    colours.set(
      rgb.map((x) => (0.9 * x) / most),
      3 * row,
    );
  }
  mesh.material.color.set("#ffffff");
  put(mesh.geometry, "color", colours);
  setVertexColours(mesh, true);
}

function setVertexColours(mesh: Mesh, on: boolean): void {
  if (mesh.material.vertexColors !== on) mesh.material.needsUpdate = true;
  mesh.material.vertexColors = on;
}

function put(geometry: THREE.BufferGeometry, name: string, data: Float32Array): void {
  const old = geometry.getAttribute(name) as THREE.BufferAttribute | undefined;
  if (old && old.array.length === data.length) {
    old.array.set(data);
    old.needsUpdate = true;
  } else geometry.setAttribute(name, new THREE.BufferAttribute(data, 3));
}
