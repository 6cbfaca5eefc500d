/** What the page asks of a worker that runs ONNX files, and what it answers. */

export interface Job {
  id: number;
  /** File of the set, or a name under which bytes were given. */
  file: string;
  rows: number;
  /** Inputs (rows, n), or one row for all. */
  inputs: Record<string, Float32Array>;
  random?: Random;
}

/** Numbers of an input `u`: so many paths a row, of mulberry32 with this seed, or those of the lattice. */
export interface Random {
  seed: number | "lattice";
  paths: number;
  /** Moves the numbers of every row on along a lattice: turn after turn they fill their space evenly. */
  turn?: number;
}

export interface Given {
  file: string;
  bytes: Uint8Array;
}

export type Request = { job: Job } | { give: Given };

export interface Output {
  data: Float32Array;
  dims: readonly number[];
}

/** `ms`: how long the evaluator ran. */
export type Answer = { id: number; outputs: Record<string, Output>; ms: number } | { id: number; error: string };
