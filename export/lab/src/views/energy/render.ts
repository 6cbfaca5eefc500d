/** Spheres under light, pass after pass: one direction a pixel from the exported sampler, its value from the model. */

import type { State } from "../../app/state";
import type { Engine } from "../../engine/client";
import { lobe, parameters } from "../../engine/surface";
import type { Entry, Manifest } from "../../files/manifest";
import type { Vec3 } from "../../geometry/directions";
import { backdrop, display, FURNACE, studio } from "./environment";
import { inWorld, sphere, type Sphere } from "./sphere";

type Light = (d: Vec3) => readonly [number, number, number];

export class Film {
  /** Sums of radiance (pixel, channel) of one bounce and of all, for each light. */
  private readonly sums: Float64Array[];
  passes = 0;
  readonly sphere: Sphere;

  constructor(size: number, share: number) {
    this.sphere = sphere(size, share);
    this.sums = Array.from({ length: 4 }, () => new Float64Array(3 * this.sphere.cells.length));
  }

  clear(): void {
    this.sums.forEach((sum) => sum.fill(0));
    this.passes = 0;
  }

  /** Adds one direction a pixel. */
  async add(engine: Engine, manifest: Manifest, state: State, entry: Entry, stale: () => boolean): Promise<void> {
    const sampler = manifest.sampler(state);
    if (!sampler) return;
    const inputs = parameters(state, manifest);
    const rows = this.sphere.cells.length;
    const random = { seed: 1, paths: 1, turn: this.passes };
    const drawn = await engine.run({ file: sampler.file, rows, inputs: { ...inputs, wi: this.sphere.wi }, random });
    if (stale()) return;
    const [wo, pdf] = [drawn["wo"]?.data, drawn["pdf"]?.data];
    if (!wo || !pdf) return;
    const question = { entry, wi: this.sphere.wi, wo, parameters: inputs };
    const found = await lobe(
      engine,
      entry.random ? { ...question, random: { seed: 7919 + this.passes, paths: 1 } } : question,
    );
    if (stale()) return;
    const furnace: Light = () => FURNACE;
    for (let row = 0; row < rows; row++) {
      const density = pdf[row] ?? 0;
      const frame = this.sphere.frames[row];
      if (!(density > 0) || !frame) continue;
      const world = inWorld(frame, [wo[3 * row] ?? 0, wo[3 * row + 1] ?? 0, wo[3 * row + 2] ?? 0]);
      [furnace, studio].forEach((light, i) => {
        const radiance = light(world);
        for (let c = 0; c < 3; c++) {
          const channel = found.channels === 1 ? "Y" : ((["R", "G", "B"] as const)[c] ?? "R");
          const scale = (radiance[c] ?? 0) / density;
          this.put(2 * i, 3 * row + c, scale * found.at(row, "1", channel));
          this.put(2 * i + 1, 3 * row + c, scale * found.at(row, "all", channel));
        }
      });
    }
    this.passes++;
  }

  private put(sum: number, at: number, value: number): void {
    const to = this.sums[sum];
    if (to && Number.isFinite(value)) to[at] = (to[at] ?? 0) + value;
  }

  /** The picture under light 0 (furnace) or 1 (studio): one bounce left of `split`, all right of it. */
  picture(light: 0 | 1, split: number): ImageData {
    const { size, cells } = this.sphere;
    const image = new ImageData(size, size);
    for (let j = 0; j < size; j++) {
      for (let i = 0; i < size; i++) image.data.set(this.background(light, i, j), 4 * (j * size + i));
    }
    cells.forEach((cell, row) => {
      const all = (cell % size) + 0.5 > split * size;
      const sum = this.sums[2 * light + (all ? 1 : 0)];
      for (let c = 0; c < 3; c++) {
        image.data[4 * cell + c] = display((sum?.[3 * row + c] ?? 0) / Math.max(1, this.passes), light === 1);
      }
    });
    return image;
  }

  private background(light: 0 | 1, i: number, j: number): [number, number, number, number] {
    const { size } = this.sphere;
    const [x, y] = [(2 * (i + 0.5)) / size - 1, 1 - (2 * (j + 0.5)) / size];
    const radiance = light === 0 ? FURNACE : backdrop(y - 0.25 * Math.abs(x));
    return [0, 1, 2].map((c) => display(radiance[c] ?? 0, light === 1)).concat(255) as [number, number, number, number];
  }
}
