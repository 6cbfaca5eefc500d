/** The two directions as handles on a sphere: drag them with mouse, pen or finger. */

import * as THREE from "three";
import type { Vec3 } from "../../geometry/directions";
import { themeColour } from "../../ui/palette";
import { label } from "./label";
import type { Stage } from "./scene";

const REACH = 1.25;

interface Handle {
  letter: string;
  /** Name of its colour in the style sheet. */
  theme: string;
  ball: THREE.Mesh<THREE.SphereGeometry, THREE.MeshBasicMaterial>;
  line: THREE.Line<THREE.BufferGeometry, THREE.LineBasicMaterial>;
  name: THREE.Sprite;
  moved: (d: Vec3) => void;
}

export class Handles {
  private readonly handles: Handle[];
  private readonly mirror: THREE.Line<THREE.BufferGeometry, THREE.LineDashedMaterial>;
  private held: Handle | null = null;
  private readonly ray = new THREE.Raycaster();

  constructor(
    private readonly stage: Stage,
    onWi: (d: Vec3) => void,
    onWo: (d: Vec3) => void,
  ) {
    this.handles = [this.handle("i", "--light", 0.055, onWi), this.handle("o", "--exit", 0.042, onWo)];
    const dashes = new THREE.LineDashedMaterial({ color: themeColour("--light"), dashSize: 0.04, gapSize: 0.04 });
    this.mirror = new THREE.Line(new THREE.BufferGeometry(), dashes);
    stage.scene.add(this.mirror);
    const canvas = stage.canvas;
    canvas.addEventListener("pointerdown", (event) => this.grab(event), { capture: true });
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"] as const) canvas.addEventListener(end, () => this.release());
  }

  private handle(letter: string, theme: string, radius: number, moved: (d: Vec3) => void): Handle {
    const colour = themeColour(theme);
    const ball = new THREE.Mesh(
      new THREE.SphereGeometry(radius, 32, 24),
      new THREE.MeshBasicMaterial({ color: colour }),
    );
    const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: colour }));
    const name = label(letter, [0, 0, 0], colour);
    this.stage.scene.add(ball, line, name);
    return { letter, theme, ball, line, name, moved };
  }

  /** Takes the colours of the theme. */
  restyle(): void {
    this.mirror.material.color.set(themeColour("--light"));
    for (const handle of this.handles) {
      const colour = themeColour(handle.theme);
      handle.ball.material.color.set(colour);
      handle.line.material.color.set(colour);
      const { x, y, z } = handle.name.position;
      this.stage.scene.remove(handle.name);
      handle.name = label(handle.letter, [x, y, z], colour);
      this.stage.scene.add(handle.name);
    }
    this.stage.draw();
  }

  /** Puts both where the state has them. */
  place(wi: Vec3, wo: Vec3): void {
    [wi, wo].forEach((d, i) => {
      const handle = this.handles[i];
      if (!handle) return;
      handle.ball.position.set(...d).multiplyScalar(REACH);
      handle.name.position.set(...d).multiplyScalar(REACH + 0.14);
      handle.line.geometry.setFromPoints([new THREE.Vector3(), handle.ball.position]);
    });
    const away = new THREE.Vector3(-wi[0], -wi[1], wi[2]);
    this.mirror.geometry.setFromPoints([new THREE.Vector3(), away.multiplyScalar(REACH)]);
    this.mirror.computeLineDistances();
    this.stage.draw();
  }

  /** Where the light's handle and the other one are on the page [px]. */
  places(): [number, number][] {
    const box = this.stage.canvas.getBoundingClientRect();
    return this.handles.map(({ ball }) => {
      const { x, y } = ball.position.clone().project(this.stage.camera);
      return [box.left + ((1 + x) / 2) * box.width, box.top + ((1 - y) / 2) * box.height];
    });
  }

  private aim(event: PointerEvent): void {
    const box = this.stage.canvas.getBoundingClientRect();
    const x = (2 * (event.clientX - box.left)) / box.width - 1;
    const y = 1 - (2 * (event.clientY - box.top)) / box.height;
    this.ray.setFromCamera(new THREE.Vector2(x, y), this.stage.camera);
  }

  /** A handle is taken if the ray passes near it: fingers are wider than it is. */
  private grab(event: PointerEvent): void {
    this.aim(event);
    const near = event.pointerType === "touch" ? 0.2 : 0.11;
    const distance = (h: Handle): number => this.ray.ray.distanceToPoint(h.ball.position);
    const [first] = [...this.handles].sort((a, b) => distance(a) - distance(b));
    if (!first || distance(first) > near) return;
    this.held = first;
    this.stage.controls.enabled = false;
    this.stage.canvas.setPointerCapture(event.pointerId);
    event.stopImmediatePropagation();
  }

  private move(event: PointerEvent): void {
    this.aim(event);
    const over = this.handles.some((h) => this.ray.ray.distanceToPoint(h.ball.position) < 0.11);
    this.stage.canvas.style.cursor = this.held ? "grabbing" : over ? "grab" : "";
    if (!this.held) return;
    const p = onSphere(this.ray.ray, this.held.ball.position);
    this.held.moved([p.x / REACH, p.y / REACH, p.z / REACH]);
  }

  private release(): void {
    this.held = null;
    this.stage.controls.enabled = true;
  }
}

/** Where the ray meets the sphere of the handles, next to `before`; its rim if it misses. */
function onSphere(ray: THREE.Ray, before: THREE.Vector3): THREE.Vector3 {
  const b = ray.origin.dot(ray.direction);
  const inside = b * b - ray.origin.lengthSq() + REACH * REACH;
  if (inside <= 0) return ray.at(-b, new THREE.Vector3()).setLength(REACH);
  const root = Math.sqrt(inside);
  const [near, far] = [ray.at(-b - root, new THREE.Vector3()), ray.at(-b + root, new THREE.Vector3())];
  return near.distanceToSquared(before) <= far.distanceToSquared(before) ? near : far;
}
