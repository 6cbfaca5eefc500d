import { describe, expect, it } from "vitest";
import { degrees, percent, precise, short } from "../src/numbers/format";
import { folded, Orders, type Bounce } from "../src/numbers/orders";
import { lattice, TURNS, turned, uniforms } from "../src/numbers/sequences";

describe("sequences", () => {
  it("integrates a polynomial far better than random numbers do", () => {
    const n = 8191;
    const error = (u: Float32Array): number => {
      let sum = 0;
      for (let i = 0; i < n; i++) sum += (u[3 * i] ?? 0) * (u[3 * i + 1] ?? 0) * (u[3 * i + 2] ?? 0);
      return Math.abs(sum / n - 1 / 8);
    };
    expect(error(lattice(n, 3))).toBeLessThan(2e-5);
    expect(error(uniforms(1, 3 * n))).toBeGreaterThan(error(lattice(n, 3)));
  });

  it("stays in [0, 1), and a seed says it all", () => {
    const u = uniforms(12345, 50_000);
    expect(Math.max(...u)).toBeLessThan(1);
    expect(Math.min(...u)).toBeGreaterThanOrEqual(0);
    expect(u.reduce((a, b) => a + b, 0) / u.length).toBeCloseTo(0.5, 2);
    expect(uniforms(12345, 3)).toEqual(u.slice(0, 3));
    expect(uniforms(12346, 3)).not.toEqual(u.slice(0, 3));
  });

  it("turns every row along the lattice", () => {
    const start = uniforms(3, 8);
    expect(turned(start, 4, 0)).toEqual(start);
    const steps = turned(start, 4, 1).map((x, i) => (x - (start[i] ?? 0) + 1) % 1);
    expect(steps[0]).toBeCloseTo(steps[4] ?? NaN, 5);
    // Over all turns every number falls once into each of 251 equal steps.
    const cells = new Set(Array.from({ length: TURNS }, (_, k) => Math.floor(TURNS * (turned(start, 4, k)[1] ?? 0))));
    expect(cells.size).toBeGreaterThan(TURNS - 3);
    expect(() => lattice(1000, 3)).toThrow("got 1000");
  });
});

describe("orders", () => {
  const data = Float32Array.from([1, 2, 3, 10, 20, 30, 100, 200, 300, 1000, 2000, 3000, 5, 6, 7, 0.5, 0.25, 0.125]);
  const orders = folded(["1", "2", "3", "4", "5", "6"], data, 1, 3);

  it("adds what bounces four times or more", () => {
    expect(orders.labels).toEqual(["1", "2", "3", "4+"]);
    expect(orders.at(0, "4+", "R")).toBe(1005.5);
    expect(orders.at(0, "all", "G")).toBeCloseTo(2 + 20 + 200 + 2006.25, 3);
    expect(orders.at(0, "2+", "B")).toBeCloseTo(30 + 300 + 3007.125, 3);
  });

  it("weights luminance, and leaves out what a model does not tell apart", () => {
    expect(orders.at(0, "1", "Y")).toBeCloseTo(0.2126 + 2 * 0.7152 + 3 * 0.0722, 6);
    const two = new Orders(["1", "2+"], Float32Array.from([1, 4]), 1, 1);
    expect([two.has("2"), two.has("2+"), two.at(0, "2+", "R")]).toEqual([false, true, 4]);
    expect(two.at(0, "3" as Bounce, "Y")).toBeNaN();
    expect(() => new Orders(["1"], Float32Array.of(1, 2), 1, 1)).toThrow("are not");
  });

  it("cuts out rows", () => {
    const list = new Orders(["1"], Float32Array.of(1, 2, 3, 4), 4, 1);
    expect([...list.slice(1, 2).column("all", "Y")]).toEqual([2, 3]);
  });
});

describe("format", () => {
  it("says numbers as a reader wants them", () => {
    expect([precise(0.123456789), precise(1e-7), precise(NaN), precise(0)]).toEqual([
      "0.123457",
      "1.00000e-7",
      "–",
      "0",
    ]);
    expect([short(0.30412), short(1234567), short(4e-5)]).toEqual(["0.304", "1.2e6", "4.0e−5"]);
    expect([percent(0.01234), percent(0.5), percent(NaN)]).toEqual(["1.23 %", "50.0 %", "–"]);
    expect(degrees(Math.PI / 2)).toBe("90.0°");
  });
});
