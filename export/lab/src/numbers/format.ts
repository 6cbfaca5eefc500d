/** Numbers as a reader wants them. */

/** Six significant digits, without an exponent where a plain number is as short. */
export function precise(x: number): string {
  if (!Number.isFinite(x)) return "–";
  if (x === 0) return "0";
  return Math.abs(x) < 1e-4 || Math.abs(x) >= 1e6 ? x.toExponential(5) : x.toPrecision(6);
}

/** Three significant digits. */
export function short(x: number): string {
  if (!Number.isFinite(x)) return "–";
  if (x === 0) return "0";
  if (Math.abs(x) < 1e-3 || Math.abs(x) >= 1e5) return x.toExponential(1).replace("e-", "e−").replace("e+", "e");
  return String(Number(x.toPrecision(3)));
}

/** A share of one, in per cent. */
export function percent(x: number): string {
  return Number.isFinite(x) ? `${(100 * x).toFixed(Math.abs(x) < 0.0995 ? 2 : 1)} %` : "–";
}

/** An angle in degrees. */
export function degrees(radians: number): string {
  return `${((radians * 180) / Math.PI).toFixed(1)}°`;
}
