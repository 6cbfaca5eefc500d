import { describe, expect, it } from "vitest";
import { START } from "../src/app/state";
import type { Engine } from "../src/engine/client";
import { integrated } from "../src/engine/energy";
import { follow, type Followed } from "../src/engine/follow";
import { Latest } from "../src/engine/latest";
import type { Job, Output } from "../src/engine/messages";
import { Manifest, MIRROR, type Entry } from "../src/files/manifest";
import { Orders } from "../src/numbers/orders";
import { mainModel, nameOf, secondModel, shown } from "../src/views/context";
import { bar, shares } from "../src/views/energy/bars";
import { csv } from "../src/takeaway/csv";
import { yTicks } from "../src/ui/line_chart";

const base = { what: "orders", material: "conductor", distribution: "ggx", bytes: 1 } as const;
const ENTRIES: Entry[] = [
  { ...base, file: "exact.onnx", model: "invariance", random: true, exact: true, orders: ["1", "2"] },
  { ...base, file: "distilled.onnx", model: "distilled", exact: false, orders: ["1", "2+"] },
  { ...base, file: "kc.onnx", model: "kulla-conty", exact: false, isotropic: true, orders: ["1", "2+"] },
  { ...base, what: "sample", file: "sample.onnx" },
];
const manifest = new Manifest("0", ENTRIES, { Au: { name: "gold", eta: [0.2, 0.4, 1.4], k: [3, 2, 2] } });

/** An engine whose exact model gives the seed as a value, and the other one 7. */
function fake(jobs: Job[]): Engine {
  const run = (job: Job): Promise<Record<string, Output>> => {
    jobs.push(job);
    const value = job.random && typeof job.random.seed === "number" ? job.random.seed : 7;
    return Promise.resolve({ orders: { data: new Float32Array(job.rows * 2).fill(value), dims: [job.rows, 2, 1] } });
  };
  return { run } as unknown as Engine;
}

describe("following a lobe", () => {
  it("averages exact models and asks the others once", async () => {
    const jobs: Job[] = [];
    const seen: Followed[] = [];
    const task = {
      engine: fake(jobs),
      manifest,
      state: { ...START, paths: 10 },
      entries: ENTRIES.slice(0, 2),
      wo: new Float32Array(6),
      pass: 4,
    };
    await follow(
      task,
      () => false,
      (now) => seen.push({ ...now, lobes: new Map(now.lobes) }),
    );
    expect(seen.map((now) => now.paths)).toEqual([4, 8, 10]);
    expect(seen.map((now) => now.done)).toEqual([false, false, true]);
    // Passes of 4, 4 and 2 paths with the values 1, 2 and 3.
    expect(seen[2]?.lobes.get("invariance")?.at(0, "1", "Y")).toBeCloseTo((4 * 1 + 4 * 2 + 2 * 3) / 10, 6);
    expect(jobs.filter((job) => job.file === "distilled.onnx")).toHaveLength(1);
  });

  it("stops when it is stale", async () => {
    const jobs: Job[] = [];
    const task = {
      engine: fake(jobs),
      manifest,
      state: START,
      entries: ENTRIES.slice(0, 1),
      wo: new Float32Array(3),
      pass: 1,
    };
    await follow(
      task,
      () => jobs.length > 2,
      () => undefined,
    );
    expect(jobs).toHaveLength(3);
  });
});

it("the newest request wins", async () => {
  const done: number[] = [];
  const work = new Latest<number>(
    async (n) => {
      await Promise.resolve();
      done.push(n);
    },
    () => undefined,
  );
  [1, 2, 3, 4].forEach((n) => work.request(n));
  await new Promise((resolve) => setTimeout(resolve, 5));
  expect(done).toEqual([1, 4]);
});

it("a failure is told, unless it is stale", async () => {
  const told: string[] = [];
  const work = new Latest<number>(
    () => Promise.reject(new Error("no")),
    (error) => told.push(error.message),
  );
  work.request(1);
  await new Promise((resolve) => setTimeout(resolve, 5));
  expect([told, work.busy]).toEqual([["no"], false]);
});

describe("models", () => {
  it("that hold for round surfaces only say so", () => {
    const brushed = { ...START, round: false, alphaY: 0.1 };
    expect(manifest.models(START).filter((m) => m.reason)).toEqual([]);
    expect(manifest.models(brushed).find((m) => m.reason)?.entry.model).toBe("kulla-conty");
    expect(mainModel(manifest, { ...brushed, model: "kulla-conty" })?.model).toBe("distilled");
    expect(mainModel(manifest, { ...START, model: "exact" })?.model).toBe("invariance");
    expect(mainModel(manifest, { ...START, material: "diffuse" })).toBeNull();
    expect(shown(manifest, brushed, ["kulla-conty", "distilled"]).map((e) => e.model)).toEqual(["distilled"]);
  });

  it("are held against another one where the chosen one is missing", () => {
    const entries = ["invariance", "distilled"].map((model) => {
      const about = { what: "orders", material: "diffuse", distribution: "ggx" } as const;
      return { ...about, file: model, bytes: 1, model, exact: model === "invariance" };
    });
    const chalk = new Manifest("0", entries, {});
    const against = (name: string): string => {
      const state = { ...START, material: "diffuse", against: name } as const;
      return `${nameOf(mainModel(chalk, state))} − ${nameOf(secondModel(chalk, state))}`;
    };
    expect(["kulla-conty", "exact", "distilled"].map(against)).toEqual([
      "distilled − exact",
      "distilled − exact",
      "distilled − distilled",
    ]);
  });

  it("have a perfect mirror", () => expect(manifest.metals.get(MIRROR)?.k).toEqual([1e5, 1e5, 1e5]));
});

describe("energies", () => {
  // Four directions of density 1/2, three up and one down; one of them was never drawn.
  const at = { wo: Float32Array.of(0, 0, 1, 0, 0, 0.5, 0, 0, 0.2, 0, 0, -1), pdf: Float32Array.of(0.5, 0.5, 0, 0.5) };
  const lobes = new Orders(["1", "2+"], Float32Array.of(0.5, 0.25, 0.5, 0.25, 9, 9, 0.5, 0), 4, 1);

  it("are means of value over density on either side", () => {
    const above = integrated(lobes, at, 1);
    expect(above.reflected.at(0, "1", "Y")).toBe(0.5);
    expect(above.reflected.at(0, "2+", "Y")).toBe(0.25);
    expect(above.transmitted.at(0, "1", "Y")).toBe(0.25);
    expect(integrated(lobes, at, -1).reflected.at(0, "1", "Y")).toBe(0.25);
  });

  it("add up to one with what is missing", () => {
    const list = shares(integrated(lobes, at, 1), "Y", "lost");
    expect(list.reduce((sum, share) => sum + share.value, 0)).toBeCloseTo(1, 9);
    expect(list.map((share) => share.name)).toEqual([
      "reflected, 1 bounce",
      "reflected, 2 or more",
      "transmitted, 1 bounce",
      "lost",
    ]);
    expect(bar).toBeTypeOf("function");
  });
});

it("tables are written as CSV with quotes where they are needed", () => {
  const text = csv([{ name: "a", head: ["x [1]", 'say, "y" [1/sr]'], rows: [[1.5, NaN]] }], "http://x/#a");
  expect(text).toBe('# http://x/#a\r\n\r\n# a\r\nx [1],"say, ""y"" [1/sr]"\r\n1.5,\r\n');
});

it("ticks are round", () => {
  expect(yTicks([0, 0.33], false)).toEqual([0, 0.1, 0.2, 0.3]);
  expect(yTicks([1e-3, 2], true)).toEqual([1e-3, 1e-2, 1e-1, 1]);
});
