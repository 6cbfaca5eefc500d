/** The state in the address, `#alpha=0.3&…`: only what differs from the start is written. */

import { CHOICES, consistent, RANGES, START, type NumberKey, type State } from "./state";

export function encode(state: State): string {
  const out = new URLSearchParams();
  for (const key of Object.keys(START) as (keyof State)[]) {
    const text = written(state[key]);
    if (text !== written(START[key])) out.set(key, text);
  }
  return out.toString();
}

/** The state of an address. What it does not know, and what is out of range, is left at the start's value. */
export function decode(hash: string): State {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  const state: State = { ...START };
  const put = state as unknown as Record<string, unknown>;
  for (const [key, text] of given) {
    if (Object.hasOwn(RANGES, key)) {
      const [low, high] = RANGES[key as NumberKey];
      const value = Number(text);
      if (text.trim() !== "" && value >= low && value <= high) put[key] = value;
    } else if (Object.hasOwn(CHOICES, key)) {
      const words: readonly string[] = CHOICES[key as keyof typeof CHOICES];
      if (words.includes(text)) put[key] = text;
    } else if (key === "round") {
      put[key] = text === "1";
    } else if (key === "models") {
      put[key] = text.split(".").filter(isName);
    } else if ((key === "metal" || key === "model" || key === "against" || key === "traced") && isName(text)) {
      put[key] = text;
    }
  }
  return consistent(state);
}

function written(value: State[keyof State]): string {
  if (typeof value === "boolean") return value ? "1" : "0";
  if (Array.isArray(value)) return value.join(".");
  return typeof value === "number" ? String(Number(value.toFixed(4))) : value;
}

function isName(text: string): boolean {
  return /^[\w,.:-]{1,40}$/.test(text);
}
