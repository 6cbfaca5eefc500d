/** A file that was dropped on the page: an evaluator that can be drawn, or a sentence that says why not. */

import type { Distribution, Material } from "../app/state";
import type { Entry } from "./manifest";
import { metadata } from "./metadata";
import { brokenSeal } from "./seal";

const KNOWN = new Set(["wi", "wo", "u", "alpha", "alpha_y", "gamma", "eta", "k", "albedo"]);
const MATERIALS: Record<string, Material> = {
  RoughConductor: "conductor",
  RoughDielectric: "dielectric",
  RoughDiffuse: "diffuse",
};
const DISTRIBUTIONS: Record<string, Distribution> = { GGX: "ggx", Beckmann: "beckmann", GTR: "gtr" };

/** Largest file that is looked at. */
const MOST_BYTES = 32 << 20;

export function examined(bytes: Uint8Array, name: string): Entry | string {
  if (bytes.length === 0) return `${name} is empty.`;
  if (bytes.length > MOST_BYTES) return `${name} is larger than 32 MB: no evaluator of torchms is.`;
  const broken = brokenSeal(bytes, name);
  if (broken) return broken;
  const about = metadata(bytes);
  if (!about) return `${name} is damaged: its metadata cannot be read. Export it again.`;
  const what = about.get("torchms.what") ?? "";
  if (what !== "orders" && what !== "forward") {
    return `${name} holds “${what}”; only “orders” and “forward” can be drawn here: torchms export --what orders.`;
  }
  const inputs = inputNames(about.get("torchms.inputs"));
  const unknown = inputs.filter((input) => !KNOWN.has(input));
  if (unknown.length) return `${name} has inputs that this page cannot set: ${unknown.join(", ")}.`;
  const described = about.get("torchms.material") ?? "";
  const material = Object.entries(MATERIALS).find(([key]) => described.startsWith(key))?.[1];
  const distribution = Object.entries(DISTRIBUTIONS).find(([key]) => new RegExp(`\\b${key}\\(`).test(described))?.[1];
  if (!material || !distribution) return `${name} is about a surface that this page does not know: ${described}.`;
  const stem = name
    .replace(/\.onnx$/i, "")
    .replace(/[^\w-]/g, "-")
    .slice(0, 24);
  return {
    file: `dropped:${stem}`,
    bytes: bytes.length,
    what: "orders",
    material,
    distribution,
    model: `dropped:${stem}`,
    random: inputs.includes("u"),
    exact: inputs.includes("u"),
    isotropic: inputs.includes("alpha") && !inputs.includes("alpha_y") && distribution !== "gtr",
    orders: what === "forward" ? ["1+"] : counted(about, material),
  };
}

/** Bounces of each order: models that tell only the first ones apart add the others to the last. */
function counted(about: Map<string, string>, material: Material): string[] {
  const [model] = (about.get("torchms.model") ?? "").split("(");
  if (model === "KullaConty" || model === "Turquin") return ["1", "2+"];
  if (model === "Distilled") return material === "dielectric" ? ["1", "2+"] : ["1", "2", "3", "4+"];
  return Array.from({ length: Number(about.get("torchms.orders") ?? 1) }, (_, k) => String(k + 1));
}

function inputNames(json: string | undefined): string[] {
  try {
    const list: unknown = JSON.parse(json ?? "");
    return Array.isArray(list) ? list.map((each) => String((each as { name?: unknown }).name)) : ["?"];
  } catch {
    return ["?"];
  }
}
