/** A surface of the state as inputs of the files, and its lobe at given directions. */

import type { State } from "../app/state";
import { direction, type Vec3 } from "../geometry/directions";
import type { Entry, Manifest } from "../files/manifest";
import { folded, Orders } from "../numbers/orders";
import type { Engine } from "./client";
import type { Output, Random } from "./messages";

/** The parameters of the state's surface by the names of the files' inputs; one value, or one a channel. */
export function parameters(state: State, manifest: Manifest): Record<string, Float32Array> {
  const metal = manifest.metals.get(state.metal) ?? manifest.metals.get("Au");
  const one = (x: number): Float32Array => Float32Array.of(x);
  return {
    alpha: one(state.alpha),
    alpha_y: one(state.alphaY),
    gamma: one(state.gamma),
    eta: state.material === "conductor" ? Float32Array.from(metal?.eta ?? [1, 1, 1]) : one(state.eta),
    k: Float32Array.from(metal?.k ?? [1, 1, 1]),
    albedo: one(state.albedo),
  };
}

/** The direction of incidence. */
export function incidence(state: State): Vec3 {
  return direction((state.theta * Math.PI) / 180, (state.phi * Math.PI) / 180);
}

/** The direction of exit at which the numbers are read. */
export function exit(state: State): Vec3 {
  return direction((state.outTheta * Math.PI) / 180, (state.outPhi * Math.PI) / 180);
}

export interface Question {
  entry: Entry;
  /** One direction, or one a row. */
  wi: Float32Array;
  wo: Float32Array;
  parameters: Record<string, Float32Array>;
  random?: Random;
}

/** Bounces of each order: those of an exact model are told apart one by one, however many there are. */
function labels(entry: Entry, output: Output): readonly string[] {
  if (!entry.exact || output.dims.length < 3) return entry.orders ?? ["1"];
  return Array.from({ length: output.dims[1] ?? 1 }, (_, k) => String(k + 1));
}

/** The first `size` values of each row: a file may end its orders with some that are always zero. */
function trimmed(data: Float32Array, size: number, rows: number): Float32Array {
  const given = data.length / rows;
  if (given <= size) return data;
  return Float32Array.from({ length: size * rows }, (_, i) => data[Math.floor(i / size) * given + (i % size)] ?? 0);
}

/** f |cos θo| [1/sr] of each bounce at the directions `wo`. */
export async function lobe(engine: Engine, question: Question): Promise<Orders> {
  const { entry, wi, wo, random } = question;
  const rows = wo.length / 3;
  const inputs = { ...question.parameters, wi, wo };
  const outputs = await engine.run({ file: entry.file, rows, inputs, ...(random ? { random } : {}) });
  const output = outputs["orders"] ?? outputs["value"];
  if (!output) throw new Error(`${entry.file} has neither orders nor a value among its outputs`);
  const channels = output.dims[output.dims.length - 1] ?? 1;
  const names = labels(entry, output);
  return folded(names, trimmed(output.data, names.length * channels, rows), rows, channels);
}
