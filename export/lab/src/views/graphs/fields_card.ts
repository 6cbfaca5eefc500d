/** G1 of GTR for γ = 0 … 4 over (α, μ) as fields of colour, and how far γ = 4 is from γ = 10. */

import { short } from "../../numbers/format";
import { el, onResize, paint } from "../../ui/dom";
import { colourBar, raster } from "../../ui/heatmap";
import { cividis, themeColour, viridis } from "../../ui/palette";
import { card } from "../card";
import type { Context } from "../context";
import { closedFields, FIELD, farField, type Field } from "./graph_data";

/** Ranges of α [1] and μ = cot θ [1] of the source's figures. */
const NEAR = { alpha: [0.1, 0.5], mu: [0.01, 5] } as const;
const FAR = { alpha: [0.01, 1], mu: [0.01, 2] } as const;

export class FieldsCard {
  private readonly card = card(
    "G1 of GTR, and what lies beyond γ = 4",
    "G1 [1] over α (to the right) and μ = cot θ (up) for γ = 0 … 4; last: how far γ = 4 is from γ = 10. Point at one.",
    "fields",
  );
  readonly element = this.card.element;
  readonly canvases = Array.from({ length: 6 }, (_, i) => el("canvas", { role: "img", id: `field-${i}` }));
  private readonly reading = el("p", { class: "note", "aria-live": "polite" }, " ");
  private fields: Field[] = [];
  private asked = false;

  constructor(private readonly context: Context) {
    const grid = el("div", { class: "panels six" }, ...this.canvases);
    this.card.body.append(grid, this.reading);
    this.canvases.forEach((canvas, i) => {
      // A finger that does not move says nothing but that it is there.
      for (const kind of ["pointerdown", "pointermove"] as const) {
        canvas.addEventListener(kind, (event) => this.read(event, i));
      }
    });
    onResize(grid, () => this.redraw());
  }

  /** They do not depend on the state: once. */
  update(): void {
    if (this.asked) return;
    this.asked = true;
    this.compute().catch((error: Error) => {
      this.asked = false;
      this.context.complain(error);
    });
  }

  private async compute(): Promise<void> {
    const { manifest, slow } = this.context;
    this.fields = await closedFields(slow, manifest, NEAR.alpha, NEAR.mu);
    this.redraw();
    this.fields.push(await farField(slow, manifest, FAR.alpha, FAR.mu));
    this.redraw();
  }

  redraw(): void {
    this.fields.forEach((field, i) => {
      const canvas = this.canvases[i];
      if (!canvas) return;
      const far = i === 5;
      const most = far ? Math.max(...field.values.filter(Number.isFinite)) : 1;
      const colour = far ? cividis : viridis;
      paint(canvas, (context, width, height) => {
        const box = { x: 34, y: 24, width: width - 44, height: height - 92 };
        context.fillStyle = themeColour("--ink");
        context.font = "600 12px system-ui, sans-serif";
        context.textBaseline = "top";
        context.textAlign = "left";
        context.fillText(far ? `${field.title}, at most ${short(most)}` : field.title, box.x, 4);
        context.imageSmoothingEnabled = false;
        const { alphas, mus } = FIELD;
        const image = raster(
          field.values.map((v) => v / most),
          alphas,
          mus,
          colour,
        );
        context.drawImage(image, box.x, box.y, box.width, box.height);
        this.axes(context, box, far ? FAR : NEAR);
        const bar = { x: box.x, y: height - 30, width: Math.floor(box.width), height: 8 };
        colourBar(
          context,
          bar,
          colour,
          ["0", far ? "difference of G1 [1]" : "G1 [1]", short(most)],
          themeColour("--soft"),
        );
      });
      canvas.setAttribute("aria-label", `G1 of GTR, ${field.title}, over α and μ`);
    });
  }

  private axes(
    context: CanvasRenderingContext2D,
    box: { x: number; y: number; width: number; height: number },
    range: typeof NEAR | typeof FAR,
  ): void {
    context.fillStyle = themeColour("--soft");
    context.font = "11px system-ui, sans-serif";
    const [left, right] = range.alpha;
    const [low, high] = range.mu;
    context.textAlign = "left";
    context.fillText(String(left), box.x, box.y + box.height + 4);
    context.textAlign = "center";
    context.fillText("α [1]", box.x + box.width / 2, box.y + box.height + 4);
    context.textAlign = "right";
    context.fillText(String(right), box.x + box.width, box.y + box.height + 4);
    context.fillText(String(high), box.x - 5, box.y);
    context.fillText("μ [1]", box.x - 5, box.y + box.height / 2 - 6);
    context.fillText(String(low), box.x - 5, box.y + box.height - 12);
    context.textAlign = "left";
  }

  private read(event: PointerEvent, index: number): void {
    const [canvas, field] = [this.canvases[index], this.fields[index]];
    if (!canvas || !field) return;
    const s = (event.offsetX - 34) / (canvas.clientWidth - 44);
    const t = (event.offsetY - 24) / (canvas.clientHeight - 92);
    if (s < 0 || s >= 1 || t < 0 || t >= 1) return;
    const { alpha, mu } = index === 5 ? FAR : NEAR;
    const at = Math.floor(t * FIELD.mus) * FIELD.alphas + Math.floor(s * FIELD.alphas);
    const a = alpha[0] + s * (alpha[1] - alpha[0]);
    const m = mu[0] + (1 - t) * (mu[1] - mu[0]);
    const value = short(field.values[at] ?? NaN);
    this.reading.textContent = `${field.title}: α = ${a.toFixed(2)}, μ = ${m.toFixed(2)}: ${value} [1]`;
  }
}
