/** Controls that set one key of the state, follow it, and say what they are to a screen reader. */

import { RANGES, type NumberKey, type State } from "../app/state";
import type { Store } from "../app/store";
import { el } from "./dom";

interface SliderText {
  label: string;
  /** Unit, or nothing for a pure number. */
  unit?: string;
  step: number;
  low?: number;
  high?: number;
}

/** A slider with its number. */
export function slider(store: Store, key: NumberKey, text: SliderText): HTMLElement {
  const [low, high] = RANGES[key];
  const range = { min: text.low ?? low, max: text.high ?? high, step: text.step };
  const input = el("input", { type: "range", id: `set-${key}`, ...range });
  const number = el("input", { type: "number", ...range, "aria-label": `${text.label}, number`, id: `number-${key}` });
  const digits = text.step >= 1 ? 0 : text.step >= 0.1 ? 1 : 2;
  const change = (from: HTMLInputElement): void => {
    const value = Number(from.value);
    const { min, max } = range;
    if (from.value !== "" && Number.isFinite(value)) store.set({ [key]: Math.max(min, Math.min(max, value)) });
  };
  input.addEventListener("input", () => change(input));
  number.addEventListener("change", () => {
    change(number);
    follow(store.state);
  });
  const follow = (state: State): void => {
    const value = state[key];
    input.value = String(value);
    input.style.setProperty("--filled", `${(100 * (value - range.min)) / (range.max - range.min)}%`);
    input.setAttribute("aria-valuetext", `${value.toFixed(digits)} ${text.unit ?? ""}`.trim());
    if (document.activeElement !== number) number.value = value.toFixed(digits);
  };
  store.subscribe((state, changed) => changed.has(key) && follow(state));
  follow(store.state);
  const unit = el("span", { class: "unit" }, text.unit ?? "");
  return el(
    "div",
    { class: "slider", "data-key": key },
    el("label", { for: input.id }, text.label),
    number,
    unit,
    input,
  );
}

/** One of several words, as a row of buttons (a radio group: arrow keys move). */
export function segmented<K extends keyof State>(
  store: Store,
  key: K,
  label: string,
  choices: readonly (readonly [State[K] & string, string])[],
): HTMLElement {
  const group = el("div", { class: "segmented", role: "radiogroup", "aria-label": label });
  for (const [value, text] of choices) {
    const id = `${key}-${value}`;
    const input = el("input", { type: "radio", name: `choose-${key}`, id, value });
    input.checked = store.state[key] === value;
    input.addEventListener("change", () => store.set({ [key]: value }));
    group.append(el("span", {}, input, el("label", { for: id, title: `${label}: ${text}` }, text)));
  }
  store.subscribe((state, changed) => {
    if (!changed.has(key)) return;
    for (const input of group.querySelectorAll("input")) input.checked = input.value === state[key];
  });
  return el("div", { class: "field", "data-key": key }, el("span", { class: "caption" }, label), group);
}

/** One of several words, as a menu; `options` may change with the state, and `chosen` says which one it stands for. */
export function menu<K extends keyof State>(
  store: Store,
  key: K,
  label: string,
  options: (state: State) => readonly (readonly [string, string])[],
  chosen: (state: State) => string = (state) => String(state[key]),
): HTMLElement {
  const select = el("select", { id: `set-${key}` });
  const follow = (state: State): void => {
    const wanted = options(state);
    if (wanted.map(String).join() !== [...select.options].map((o) => `${o.value},${o.text}`).join()) {
      select.replaceChildren(...wanted.map(([value, text]) => el("option", { value }, text)));
    }
    select.value = chosen(state);
  };
  select.addEventListener("change", () => store.set({ [key]: select.value }));
  store.subscribe(follow);
  follow(store.state);
  return el(
    "div",
    { class: "field", "data-key": key },
    el("label", { class: "caption", for: select.id }, label),
    select,
  );
}

/** A box to tick. */
export function toggle(store: Store, key: "round", label: string, inverse: boolean): HTMLElement {
  const input = el("input", { type: "checkbox", id: `set-${key}` });
  const follow = (state: State): void => void (input.checked = state[key] !== inverse);
  input.addEventListener("change", () => store.set({ [key]: input.checked !== inverse }));
  store.subscribe(follow);
  follow(store.state);
  return el("div", { class: "tick", "data-key": key }, input, el("label", { for: input.id }, label));
}
