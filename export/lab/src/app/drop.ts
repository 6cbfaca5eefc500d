/** A file of one's own: dropped on the page or chosen; examined first, then one model more. */

import type { Engine } from "../engine/client";
import { examined } from "../files/foreign";
import type { Manifest } from "../files/manifest";
import { el } from "../ui/dom";
import { switched } from "./model_choice";
import type { Store } from "./store";

export function dropZone(
  store: Store,
  manifest: Manifest,
  engines: readonly Engine[],
  complain: (message: string) => void,
): HTMLElement {
  const input = el("input", { type: "file", accept: ".onnx", id: "open-file", class: "unseen" });
  const take = async (file: File): Promise<void> => {
    const bytes = new Uint8Array(await file.arrayBuffer());
    const entry = examined(bytes, file.name);
    if (typeof entry === "string") return complain(entry);
    for (const engine of engines) engine.give(entry.file, bytes);
    const known = manifest.entries.findIndex((each) => each.file === entry.file);
    if (known >= 0) manifest.entries.splice(known, 1);
    manifest.entries.push(entry);
    const { material = "conductor", distribution = "ggx", model = "" } = entry;
    store.set({ models: switched(store.state.models, model, false) });
    store.set({ material, distribution, model, models: switched(store.state.models, model, true), view: "lobes" });
  };
  input.addEventListener("change", () => {
    const [file] = input.files ?? [];
    if (file) void take(file);
    input.value = "";
  });
  window.addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  window.addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) document.body.classList.remove("dropping");
  });
  window.addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dropping");
    const [file] = event.dataTransfer?.files ?? [];
    if (file) void take(file);
  });
  const label = el("label", { for: input.id, class: "open" }, "Open an evaluator of your own (.onnx), or drop it here");
  return el("div", { class: "drop" }, input, label);
}
