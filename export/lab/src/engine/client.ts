/** The page's side of a worker: one promise a job. */

import type { Answer, Job, Output, Request } from "./messages";

type Asked = Omit<Job, "id">;

export class Engine {
  private readonly worker: Worker;
  private readonly waiting = new Map<
    number,
    { resolve: (o: Record<string, Output>) => void; reject: (e: Error) => void }
  >();
  private next = 1;

  constructor() {
    this.worker = new Worker(new URL("./engine.worker.ts", import.meta.url), { type: "module" });
    this.worker.postMessage({ folder: new URL("models/", document.baseURI).href });
    this.worker.addEventListener("message", (event: MessageEvent<Answer>) => this.settle(event.data));
    this.worker.addEventListener("error", (event) => this.fail(event.message));
  }

  run(job: Asked): Promise<Record<string, Output>> {
    const id = this.next++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ job: { ...job, id } } satisfies Request);
    });
  }

  /** Bytes of a file that is not in the set. */
  give(file: string, bytes: Uint8Array): void {
    this.worker.postMessage({ give: { file, bytes } } satisfies Request);
  }

  private settle(answer: Answer): void {
    const asked = this.waiting.get(answer.id);
    this.waiting.delete(answer.id);
    if ("outputs" in answer) asked?.resolve(answer.outputs);
    else asked?.reject(new Error(answer.error));
  }

  private fail(message: string): void {
    for (const { reject } of this.waiting.values()) reject(new Error(message || "the worker could not be started"));
    this.waiting.clear();
  }
}
