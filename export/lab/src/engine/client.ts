/** The page's side of a worker: one promise a job. */

import type { Answer, Job, Output, Request } from "./messages";

type Asked = Omit<Job, "id">;

export class Engine {
  private worker: Promise<Worker> | null = null;
  private readonly waiting = new Map<
    number,
    { resolve: (o: Record<string, Output>) => void; reject: (e: Error) => void }
  >();
  private next = 1;
  /** Answers so far, and how long the evaluators ran for them [ms]. */
  readonly spent = { answers: 0, ms: 0 };

  private answered: () => void = () => undefined;
  /** Fulfilled by the first answer. */
  readonly ready = new Promise<void>((resolve) => (this.answered = resolve));

  /** It starts with the first job, not before `after`: the first picture does not share the processor. */
  constructor(private readonly after: Promise<void> = Promise.resolve()) {}

  private start(): Worker {
    const worker = new Worker(new URL("./engine.worker.ts", import.meta.url), { type: "module" });
    worker.postMessage({ folder: new URL("models/", document.baseURI).href });
    worker.addEventListener("message", (event: MessageEvent<Answer>) => this.settle(event.data));
    worker.addEventListener("error", (event) => this.fail(event.message));
    return worker;
  }

  private post(request: Request): void {
    this.worker ??= this.after.then(() => this.start());
    void this.worker.then((worker) => worker.postMessage(request));
  }

  run(job: Asked): Promise<Record<string, Output>> {
    const id = this.next++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.post({ job: { ...job, id } });
    });
  }

  /** Bytes of a file that is not in the set. */
  give(file: string, bytes: Uint8Array): void {
    this.post({ give: { file, bytes } });
  }

  private settle(answer: Answer): void {
    this.answered();
    const asked = this.waiting.get(answer.id);
    this.waiting.delete(answer.id);
    if ("outputs" in answer) {
      this.spent.answers++;
      this.spent.ms += answer.ms;
      asked?.resolve(answer.outputs);
    } else asked?.reject(new Error(answer.error));
  }

  private fail(message: string): void {
    this.answered();
    for (const { reject } of this.waiting.values()) reject(new Error(message || "the worker could not be started"));
    this.waiting.clear();
  }
}
