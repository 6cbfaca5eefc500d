// node run.mjs model.onnx feeds.json: runs the model on {name: {type, dims, data}}, prints the outputs in the same form.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";

const ort = createRequire(import.meta.url)("onnxruntime-node");
const [model, feeds] = process.argv.slice(2);
const arrays = { float32: Float32Array, float64: Float64Array, int64: BigInt64Array };

const session = await ort.InferenceSession.create(model);
const inputs = {};
for (const [name, { type, dims, data }] of Object.entries(JSON.parse(readFileSync(feeds, "utf8")))) {
  // 64-bit integers are written as strings: a number of JavaScript cannot hold them.
  inputs[name] = new ort.Tensor(type, arrays[type].from(type === "int64" ? data.map(BigInt) : data), dims);
}
const results = await session.run(inputs);
const written = {};
for (const [name, { type, dims, data }] of Object.entries(results)) {
  written[name] = { type, dims, data: Array.from(data, Number) };
}
console.log(JSON.stringify({ version: ort.env.versions.node, outputs: written }));
