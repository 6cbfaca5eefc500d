/** The seal at the end of a file of torchms: its format, and the SHA-256 of all bytes before it. */

import { sha256 } from "@noble/hashes/sha2.js";

const KEY = "torchms.seal";
const FORMAT = 1;
const VALUE = 3 + 1 + 64;
const PREFIX_HEAD = [(14 << 3) | 2, 2 + KEY.length + 2 + VALUE, (1 << 3) | 2, KEY.length];

/** What is wrong with a file, as a sentence; null if its seal holds. */
export function brokenSeal(bytes: Uint8Array, name: string): string | null {
  const prefix = [...PREFIX_HEAD, ...new TextEncoder().encode(KEY), (2 << 3) | 2, VALUE];
  const start = bytes.length - prefix.length - VALUE;
  if (start < 0 || prefix.some((byte, i) => bytes[start + i] !== byte)) {
    return contains(bytes, "torchms.conventions")
      ? `${name} is damaged, or was changed by another tool: it does not end with its seal. Export it again.`
      : `${name} was not written by torchms: it carries no seal of it. Write one with “torchms export”.`;
  }
  const [format, digest] = new TextDecoder().decode(bytes.subarray(start + prefix.length)).split(" ");
  if (!/^\d+$/.test(format ?? "")) return `${name} is damaged: its seal cannot be read. Export it again.`;
  if (Number(format) > FORMAT) return `${name} is of format ${Number(format)}; this page reads up to ${FORMAT}.`;
  const found = Array.from(sha256(bytes.subarray(0, start)), (b) => b.toString(16).padStart(2, "0")).join("");
  return found === digest ? null : `${name} is damaged: its content does not match its seal. Export it again.`;
}

function contains(bytes: Uint8Array, text: string): boolean {
  const wanted = new TextEncoder().encode(text);
  for (let i = bytes.indexOf(wanted[0] ?? 0); i >= 0; i = bytes.indexOf(wanted[0] ?? 0, i + 1)) {
    if (wanted.every((byte, k) => bytes[i + k] === byte)) return true;
  }
  return false;
}
