import { sha256 } from "@noble/hashes/sha2.js";
import { describe, expect, it } from "vitest";
import { examined } from "../src/files/foreign";
import { metadata } from "../src/files/metadata";
import { brokenSeal } from "../src/files/seal";

const text = new TextEncoder();
const varint = (n: number): number[] => (n < 128 ? [n] : [(n & 127) | 128, ...varint(n >> 7)]);
const field = (k: number, content: Iterable<number>): number[] => {
  const bytes = [...content];
  return [(k << 3) | 2, ...varint(bytes.length), ...bytes];
};
const entry = (key: string, value: string): number[] =>
  field(14, [...field(1, text.encode(key)), ...field(2, text.encode(value))]);

/** A file as torchms writes it, without a graph. */
function file(about: Record<string, string>, format = "001"): Uint8Array {
  const body = Uint8Array.from([0x08, 0x0a, ...Object.entries(about).flatMap(([k, v]) => entry(k, v))]);
  const digest = Array.from(sha256(body), (b) => b.toString(16).padStart(2, "0")).join("");
  return Uint8Array.from([...body, ...entry("torchms.seal", `${format} ${digest}`)]);
}

const ABOUT = {
  "torchms.conventions": "…",
  "torchms.what": "orders",
  "torchms.material": "RoughConductor( (distribution): Beckmann(alpha=0.5) )",
  "torchms.orders": "3",
  "torchms.inputs": JSON.stringify([{ name: "wi" }, { name: "wo" }, { name: "u" }, { name: "alpha" }]),
};

describe("a file that is dropped", () => {
  it("is taken if it is whole", () => {
    const found = examined(file(ABOUT), "my file.onnx");
    expect(found).toMatchObject({ material: "conductor", distribution: "beckmann", exact: true, isotropic: true });
    expect(found).toMatchObject({ orders: ["1", "2", "3"], model: "dropped:my-file" });
    const orders = (model: string): unknown =>
      examined(file({ ...ABOUT, "torchms.model": model, "torchms.orders": "4" }), "a.onnx");
    expect(orders("Distilled( GGX )")).toMatchObject({ orders: ["1", "2", "3", "4+"] });
    expect(orders("KullaConty( )")).toMatchObject({ orders: ["1", "2+"] });
  });

  it.each([
    ["empty", new Uint8Array(0), "is empty"],
    ["a picture", Uint8Array.from({ length: 5000 }, (_, i) => (i * 37) % 256), "was not written by torchms"],
    ["of a newer format", file(ABOUT, "007"), "is of format 7"],
    ["a density", file({ ...ABOUT, "torchms.what": "pdf" }), "only “orders” and “forward”"],
    ["of another input", file({ ...ABOUT, "torchms.inputs": '[{"name":"wi"},{"name":"seed"}]' }), "cannot set: seed"],
    ["of no inputs", file({ ...ABOUT, "torchms.inputs": "{" }), "cannot set"],
    ["about something else", file({ ...ABOUT, "torchms.material": "Cloud()" }), "does not know: Cloud()"],
  ])("gets a sentence if it is %s", (_, bytes, says) => {
    const found = examined(bytes, "x.onnx");
    expect(found).toBeTypeOf("string");
    expect(found).toContain(says);
    expect(found).toMatch(/^x\.onnx .*\.$|^x\.onnx .*: .*/);
  });

  it("is refused if any byte has changed or the end is missing", () => {
    const whole = file(ABOUT);
    expect(brokenSeal(whole, "x")).toBeNull();
    for (let i = 0; i < whole.length; i++) {
      const bytes = Uint8Array.from(whole);
      bytes[i] = (bytes[i] ?? 0) ^ 4;
      expect(examined(bytes, "x"), `byte ${i}`).toBeTypeOf("string");
    }
    for (const n of [1, 10, 50, whole.length - 1]) expect(examined(whole.subarray(0, n), "x")).toBeTypeOf("string");
  });
});

describe("metadata", () => {
  it("is read from behind other fields", () => {
    const bytes = Uint8Array.from([
      0x08,
      0x96,
      0x01,
      ...field(7, [1, 2, 3]),
      0x11,
      ...Array(8).fill(0),
      ...entry("a", "b"),
    ]);
    expect([...(metadata(bytes) ?? [])]).toEqual([["a", "b"]]);
  });

  it("is none of a damaged file", () => {
    expect(metadata(Uint8Array.of(0x0a, 0xff, 0xff, 0xff, 0x7f))).toBeNull();
    expect(metadata(Uint8Array.of(0x0b))).toBeNull();
    expect(metadata(new Uint8Array(0))).toBeNull();
  });
});
