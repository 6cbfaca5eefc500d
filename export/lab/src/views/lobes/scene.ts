/** The stage: surface, axes, light and camera in 3-D. */

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { direction } from "../../geometry/directions";
import { atFrame } from "../../ui/dom";
import { themeColour } from "../../ui/palette";
import { graphics, type Quality } from "./graphics";
import { label } from "./label";

/** Milliseconds without a picture after which nothing moves. */
const REST = 160;

export class Stage {
  readonly scene = new THREE.Scene();
  readonly camera = new THREE.PerspectiveCamera(32, 1, 0.05, 50);
  readonly renderer: THREE.WebGLRenderer;
  readonly controls: OrbitControls;
  private readonly decor = new THREE.Group();
  private readonly quality: Quality;
  private timer = 0;
  /** Pictures drawn so far. */
  frames = 0;

  constructor(readonly canvas: HTMLCanvasElement) {
    const { context, quality } = graphics(canvas);
    this.quality = quality;
    this.renderer = new THREE.WebGLRenderer({ canvas, context });
    this.renderer.setPixelRatio(quality.resting);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.minDistance = 2;
    this.controls.maxDistance = 9;
    this.controls.enablePan = false;
    this.controls.addEventListener("change", () => this.draw());
    this.look(false);
    this.scene.add(this.decor);
    this.addLights();
    this.restyle();
  }

  /** Puts the camera where one side of the surface, or both, are seen whole. */
  look(both: boolean): void {
    if (both) this.camera.position.set(1.75, -5.1, 1.5);
    else this.camera.position.set(1.5, -3.7, 1.75);
    this.controls.target.set(0, 0, both ? 0 : 0.36);
    this.controls.update();
  }

  /** Turns the camera about the target by angles [rad], and brings it nearer by a factor. */
  turn(around: number, up: number, nearer = 1): void {
    const { target, minDistance, maxDistance } = this.controls;
    const [x, y, z] = this.camera.position.clone().sub(target).toArray();
    const distance = Math.max(minDistance, Math.min(maxDistance, Math.hypot(x, y, z) * nearer));
    const polar = Math.max(0.05, Math.min(Math.PI - 0.05, Math.atan2(Math.hypot(x, y), z) - up));
    const azimuth = Math.atan2(y, x) + around;
    this.camera.position.set(...direction(polar, azimuth)).multiplyScalar(distance);
    this.camera.position.add(target);
    this.controls.update();
    this.draw();
  }

  private addLights(): void {
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0xb8bccb, 2.2));
    const key = new THREE.DirectionalLight(0xffffff, 2.1);
    key.position.set(-1.5, -3, 4);
    const back = new THREE.DirectionalLight(0xbfd4ff, 0.8);
    back.position.set(3, 3, 1);
    this.scene.add(key, back);
  }

  /** The surface as a disc with rings every quarter and spokes every 30°, in the colours of the theme. */
  restyle(): void {
    this.decor.clear();
    const surface = new THREE.Mesh(
      new THREE.CircleGeometry(1.18, 96),
      new THREE.MeshBasicMaterial({
        color: themeColour("--disc"),
        transparent: true,
        opacity: 0.72,
        side: THREE.DoubleSide,
        depthWrite: false,
      }),
    );
    this.decor.add(surface);
    const line = new THREE.LineBasicMaterial({ color: themeColour("--line-3d"), transparent: true, opacity: 0.9 });
    for (const radius of [0.25, 0.5, 0.75, 1]) {
      const ring = Array.from({ length: 129 }, (_, i) => polar(radius, (i * Math.PI) / 64));
      this.decor.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(ring), line));
    }
    for (let i = 0; i < 12; i++) {
      const spoke = [polar(0.25, (i * Math.PI) / 6), polar(1.18, (i * Math.PI) / 6)];
      this.decor.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(spoke), line));
    }
    const normal = [new THREE.Vector3(0, 0, 0), new THREE.Vector3(0, 0, 1.12)];
    this.decor.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(normal), line));
    const ink = themeColour("--soft");
    this.decor.add(label("n", [0, 0, 1.2], ink), label("x", [1.28, 0, 0], ink), label("y", [0, 1.28, 0], ink));
    this.draw();
  }

  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    // A narrow screen takes a wider angle: the surface is seen whole.
    this.camera.fov = width < 1.2 * height ? 37 : 32;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  /** Draws at the next frame, once however often it is asked for; finer once nothing has moved for a while. */
  readonly draw = atFrame(() => {
    this.frames++;
    this.render(this.quality.moving);
    window.clearTimeout(this.timer);
    if (this.quality.moving !== this.quality.resting) this.timer = window.setTimeout(() => this.render(), REST);
  });

  /** Milliseconds of a picture as it is drawn while something moves, to its last pixel. */
  timed(): number {
    const context = this.renderer.getContext();
    const start = performance.now();
    this.render(this.quality.moving);
    context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, new Uint8Array(4));
    return performance.now() - start;
  }

  /** Draws now. */
  render(ratio = this.quality.resting): void {
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    this.renderer.render(this.scene, this.camera);
  }
}

function polar(radius: number, angle: number): THREE.Vector3 {
  return new THREE.Vector3(radius * Math.cos(angle), radius * Math.sin(angle), 0);
}
