import { describe, expect, it } from "vitest";
import { applies } from "../src/app/panel";
import { consistent, START, type State } from "../src/app/state";
import { decode, encode } from "../src/app/url";

describe("the address", () => {
  it("holds every state", () => {
    const state = consistent({
      ...START,
      view: "energy",
      material: "dielectric",
      round: false,
      alpha: 0.3,
      alphaY: 0.9,
      eta: 1.33,
      theta: 120,
      models: ["distilled", "height-walk"],
      bounce: "2+",
      scale: "log",
      metal: "Cu",
    });
    expect(decode(`#${encode(state)}`)).toEqual(state);
    expect(encode(START)).toBe("");
    expect(decode("")).toEqual(START);
  });

  it("takes nothing that is out of range or unknown", () => {
    const wild = "#alpha=7&theta=-3&view=moon&metal=<script>&paths=NaN&albedo=&model=../../etc&nonsense=1&__proto__=1";
    expect(decode(wild)).toEqual(START);
  });
});

describe("a state", () => {
  const state = (change: Partial<State>): State => consistent({ ...START, ...change });

  it("holds together", () => {
    expect(state({ distribution: "gtr", round: false, alphaY: 0.1 }).alphaY).toBe(START.alpha);
    expect(state({ theta: 120 }).theta).toBe(89);
    expect(state({ theta: 90.2, material: "dielectric" }).theta).toBe(91);
  });

  it("shows the controls that mean something", () => {
    expect(applies("metal", state({}))).toBe(true);
    expect(applies("eta", state({}))).toBe(false);
    expect(applies("gamma", state({ distribution: "gtr" }))).toBe(true);
    expect(applies("alphaY", state({ round: false }))).toBe(true);
    expect(applies("alpha", state({ view: "surface" }))).toBe(false);
    expect(applies("alpha", state({ view: "graphs" }))).toBe(true);
  });
});
