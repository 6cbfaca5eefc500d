/** A titled box of the page. */

import { el } from "../ui/dom";

export interface Card {
  element: HTMLElement;
  title: HTMLElement;
  note: HTMLElement;
  body: HTMLElement;
}

/** `note` says in one line what is seen, with units. */
export function card(title: string, note: string, kind: string): Card {
  const heading = el("h2", {}, title);
  const line = el("p", { class: "note" }, note);
  const body = el("div", { class: "body" });
  return {
    element: el("section", { class: `card ${kind}`, "aria-label": title }, heading, line, body),
    title: heading,
    note: line,
    body,
  };
}
