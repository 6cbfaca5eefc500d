/** What an evaluator returns, by bounce: labels "1", "2", "3", "4+" or "2+", and values (rows, bounces, channels). */

export type Bounce = "all" | "1" | "2" | "3" | "4+" | "2+";
export type Channel = "Y" | "R" | "G" | "B";

/** Luminance of linear sRGB (Rec. 709). */
const LUMINANCE = [0.2126, 0.7152, 0.0722] as const;

export class Orders {
  constructor(
    readonly labels: readonly string[],
    readonly data: Float32Array,
    readonly rows: number,
    readonly channels: number,
  ) {
    if (data.length !== rows * labels.length * channels) {
      throw new Error(`${data.length} values are not ${rows} × ${labels.length} × ${channels}.`);
    }
  }

  /** Weight of each channel in this one. */
  private weights(channel: Channel): readonly number[] {
    if (this.channels === 1) return [1];
    return channel === "Y" ? LUMINANCE : [..."RGB"].map((name) => (name === channel ? 1 : 0));
  }

  /** The first bounce and the one after the last that a name stands for; null where the model does not tell it apart. */
  private span(bounce: Bounce): readonly [number, number] | null {
    const n = this.labels.length;
    if (bounce === "all") return [0, n];
    if (bounce === "2+") return [1, n];
    const index = this.labels.indexOf(bounce);
    return index < 0 ? null : [index, index + 1];
  }

  /** Value of one row: these bounces added, in this channel. */
  private added(row: number, [from, to]: readonly [number, number], weights: readonly number[]): number {
    let sum = 0;
    for (let b = from; b < to; b++) {
      const at = (row * this.labels.length + b) * this.channels;
      for (let c = 0; c < this.channels; c++) sum += (weights[c] ?? 0) * (this.data[at + c] ?? 0);
    }
    return sum;
  }

  /** Whether this model tells the bounce apart from others. */
  has(bounce: Bounce): boolean {
    return this.span(bounce) !== null;
  }

  /** Value of a row for a bounce; NaN where the model does not tell it apart. */
  at(row: number, bounce: Bounce, channel: Channel): number {
    const span = this.span(bounce);
    return span ? this.added(row, span, this.weights(channel)) : NaN;
  }

  /** All rows of a bounce. */
  column(bounce: Bounce, channel: Channel): Float64Array {
    const found = new Float64Array(this.rows).fill(NaN);
    const [span, weights] = [this.span(bounce), this.weights(channel)];
    if (span) for (let row = 0; row < this.rows; row++) found[row] = this.added(row, span, weights);
    return found;
  }

  /** Rows from `start` on, `n` of them. */
  slice(start: number, n: number): Orders {
    const size = this.labels.length * this.channels;
    return new Orders(this.labels, this.data.subarray(start * size, (start + n) * size), n, this.channels);
  }
}

/** Orders told apart one by one, folded to at most four: what bounces four times or more is added up. */
export function folded(labels: readonly string[], data: Float32Array, rows: number, channels: number): Orders {
  if (labels.length <= 4) return new Orders(labels, data, rows, channels);
  const out = new Float32Array(rows * 4 * channels);
  for (let row = 0; row < rows; row++) {
    for (let k = 0; k < labels.length; k++) {
      for (let c = 0; c < channels; c++) {
        const to = (row * 4 + Math.min(k, 3)) * channels + c;
        out[to] = (out[to] ?? 0) + (data[(row * labels.length + k) * channels + c] ?? 0);
      }
    }
  }
  return new Orders(["1", "2", "3", "4+"], out, rows, channels);
}
