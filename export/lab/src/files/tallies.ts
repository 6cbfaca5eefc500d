/** Lobes of explicit surfaces, ray-traced, as `python -m export.lab_tallies` stored them. */

import type { Material } from "../app/state";

export interface Traced {
  material: Material;
  alpha: [number, number];
  /** Angle of incidence [rad]. */
  theta: number;
  /** Angle in the plane of incidence [rad], positive on the mirror's side. */
  angle: number[];
  /** Value and standard error [1/sr] of 1, 2, 3, 4 or more and all bounces. */
  value: number[][];
  stderr: number[][];
  /** Energies [1] of 1, 2, 3, 4 or more. */
  reflected: number[];
  transmitted: number[];
}

export interface Tallies {
  what: string;
  command: string;
  bounces: string[];
  cases: Traced[];
}

export async function loadTallies(): Promise<Tallies> {
  const answer = await fetch("microsurface.json");
  if (!answer.ok) throw new Error("microsurface.json is missing: run “python -m export.lab_tallies”.");
  return (await answer.json()) as Tallies;
}

/** The case of a material, a roughness such as "0.5" or "1,0.1", and an angle. */
export function traced(tallies: Tallies, material: Material, alpha: string, theta: number): Traced | null {
  const [ax, ay = ax] = alpha.split(",").map(Number);
  const fits = (c: Traced): boolean => c.material === material && c.alpha[0] === ax && c.alpha[1] === ay;
  const [nearest] = tallies.cases.filter(fits).sort((a, b) => Math.abs(a.theta - theta) - Math.abs(b.theta - theta));
  return nearest ?? null;
}

/** How roughnesses of a case are written in the state. */
export function alphaName(alpha: readonly [number, number]): string {
  return alpha[0] === alpha[1] ? String(alpha[0]) : alpha.join(",");
}
