/** Runs the exported files away from the page, so that it stays fluent. */

import * as ort from "onnxruntime-web/wasm";
import wasm from "onnxruntime-web/ort-wasm-simd-threaded.wasm?url";
import type { Answer, Job, Request } from "./messages";
import { run } from "./session";

ort.env.wasm.wasmPaths = { wasm: new URL(wasm, self.location.href).href };
// Two workers run side by side; threads within one would need headers that not every file server sends.
ort.env.wasm.numThreads = 1;
ort.env.logLevel = "error";

const sessions = new Map<string, Promise<ort.InferenceSession>>();
const given = new Map<string, Uint8Array>();
let folder = "";
let queue = Promise.resolve();

/** Opened when it is first used; a file that cannot be opened is tried again next time. */
function session(file: string): Promise<ort.InferenceSession> {
  let found = sessions.get(file);
  if (!found) {
    found = opened(file);
    found.catch(() => sessions.delete(file));
    sessions.set(file, found);
  }
  return found;
}

async function opened(file: string): Promise<ort.InferenceSession> {
  let bytes = given.get(file);
  if (!bytes) {
    const answer = await fetch(`${folder}${file}`);
    if (!answer.ok) throw new Error(`models/${file} is missing`);
    bytes = new Uint8Array(await answer.arrayBuffer());
  }
  // More than the basic optimisations take longer to make than they save.
  return ort.InferenceSession.create(bytes, { executionProviders: ["wasm"], graphOptimizationLevel: "basic" });
}

async function serve(job: Job): Promise<void> {
  try {
    const opened = await session(job.file);
    const start = performance.now();
    const outputs = await run(opened, job);
    const ms = performance.now() - start;
    const buffers = Object.values(outputs).map((output) => output.data.buffer as ArrayBuffer);
    self.postMessage({ id: job.id, outputs, ms } satisfies Answer, { transfer: buffers });
  } catch (error) {
    self.postMessage({ id: job.id, error: error instanceof Error ? error.message : String(error) } satisfies Answer);
  }
}

self.addEventListener("message", (event: MessageEvent<Request | { folder: string }>) => {
  const request = event.data;
  if ("folder" in request) folder = request.folder;
  else if ("give" in request) {
    given.set(request.give.file, request.give.bytes);
    sessions.delete(request.give.file);
  } else queue = queue.then(() => serve(request.job));
});
