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

  /** Value of one row: the bounces with these indices added, in this channel. */
  private added(row: number, from: number, to: number, channel: Channel): number {
    let sum = 0;
    for (let b = from; b < to; b++) {
      const at = (row * this.labels.length + b) * this.channels;
      for (let c = 0; c < this.channels; c++) sum += this.weight(c, channel) * (this.data[at + c] ?? 0);
    }
    return sum;
  }

  private weight(c: number, channel: Channel): number {
    if (this.channels === 1) return 1;
    return channel === "Y" ? (LUMINANCE[c] ?? 0) : "RGB".indexOf(channel) === c ? 1 : 0;
  }

  /** Whether this model tells the bounce apart from others. */
  has(bounce: Bounce): boolean {
    return bounce === "all" || bounce === "2+" || this.labels.includes(bounce);
  }

  /** Value of a row for a bounce; NaN where the model does not tell it apart. */
  at(row: number, bounce: Bounce, channel: Channel): number {
    const n = this.labels.length;
    if (bounce === "all") return this.added(row, 0, n, channel);
    if (bounce === "2+") return this.added(row, 1, n, channel);
    const index = this.labels.indexOf(bounce);
    return index < 0 ? NaN : this.added(row, index, index + 1, channel);
  }

  /** All rows of a bounce. */
  column(bounce: Bounce, channel: Channel): Float64Array {
    return Float64Array.from({ length: this.rows }, (_, row) => this.at(row, bounce, channel));
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
