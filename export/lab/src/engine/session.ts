/** One exported file in ONNX Runtime: named inputs to named outputs, block after block. */

import * as ort from "onnxruntime-web/wasm";
import { lattice, turned, uniforms } from "../numbers/sequences";
import type { Job, Output, Random } from "./messages";

/** Rows of a block: a run costs one to five milliseconds however few they are, and more rows leave the cache. */
const BLOCK = 4096;

export async function run(session: ort.InferenceSession, job: Job): Promise<Record<string, Output>> {
  const parts: ort.InferenceSession.OnnxValueMapType[] = [];
  const shared = job.random ? random(session, job.rows, job.random) : null;
  for (let start = 0; start < job.rows; start += BLOCK) {
    const rows = Math.min(BLOCK, job.rows - start);
    const feeds: Record<string, ort.Tensor> = {};
    for (const name of session.inputNames) {
      if (name === "u" && shared) {
        const each = shared.data.length / job.rows;
        const part = shared.data.subarray(start * each, (start + rows) * each);
        feeds[name] = new ort.Tensor("float32", part, [rows, ...shared.dims]);
      } else feeds[name] = block(session, name, job, start, rows);
    }
    parts.push(await session.run(feeds));
  }
  return Object.fromEntries(session.outputNames.map((name) => [name, joined(parts, name, job.rows)]));
}

/** Shape of an input after the batch axis; an axis without a fixed length is not a number. */
function trailing(session: ort.InferenceSession, name: string): (number | string)[] {
  const about = session.inputMetadata.find((each) => each.name === name);
  return about?.isTensor ? [...about.shape].slice(1) : [];
}

function random(session: ort.InferenceSession, rows: number, given: Random): Output {
  const [paths, numbers] = trailing(session, "u");
  const dims = [typeof paths === "number" ? paths : given.paths, Number(numbers)];
  const [n, d] = [rows * (dims[0] ?? 1), dims[1] ?? 1];
  const data = given.seed === "lattice" ? lattice(n, d) : uniforms(given.seed, n * d);
  return { data: given.turn === undefined ? data : turned(data, d, given.turn), dims };
}

/** Rows [start, start + rows) of an input; what was given once serves all rows. */
function block(session: ort.InferenceSession, name: string, job: Job, start: number, rows: number): ort.Tensor {
  const given = job.inputs[name];
  if (!given) throw new Error(`${job.file} has the input ${name}, which this page does not set`);
  const dims = trailing(session, name);
  const width = dims.reduce<number>((product, n) => product * Number(n), 1);
  if (given.length === width * job.rows) {
    return new ort.Tensor("float32", given.subarray(start * width, (start + rows) * width), [
      rows,
      ...dims.map(Number),
    ]);
  }
  const all = new Float32Array(rows * width);
  for (let i = 0; i < all.length; i++) all[i] = given[(i % width) % given.length] ?? 0;
  return new ort.Tensor("float32", all, [rows, ...dims.map(Number)]);
}

function joined(parts: ort.InferenceSession.OnnxValueMapType[], name: string, rows: number): Output {
  const tensors = parts.map((part) => part[name] as ort.Tensor);
  const dims = [rows, ...(tensors[0]?.dims.slice(1) ?? [])];
  const data = new Float32Array(dims.reduce((a, b) => a * b, 1));
  let at = 0;
  for (const tensor of tensors) {
    data.set(tensor.data as Float32Array, at);
    at += tensor.data.length;
    tensor.dispose();
  }
  return { data, dims };
}
