import { describe, expect, it } from "vitest";
import { angles, cross, direction, dot, mirrored, planeOfIncidence, type Vec3 } from "../src/geometry/directions";
import { disc, onDisc } from "../src/geometry/disc";
import { lobeGrid } from "../src/geometry/lobe_grid";

const POLES: Vec3[] = [direction(0, 0), direction(0.9, 2), direction(1.5, -1), direction(Math.PI - 0.4, 0.3)];

describe("the grid of a lobe", () => {
  it.each(POLES.map((pole) => [pole]))("fills the hemisphere of its pole %s", (pole) => {
    const side = pole[2] > 0 ? 1 : -1;
    const { directions, triangles } = lobeGrid(pole, side, 0.4, 40, 80);
    for (const d of directions) {
      expect(side * d[2]).toBeGreaterThan(-1e-9);
      expect(dot(d, d)).toBeCloseTo(1, 9);
    }
    // Triangles face outwards, and their solid angles add up to 2π.
    let area = 0;
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => directions[triangles[t + k] ?? 0]) as [Vec3, Vec3, Vec3];
      const volume = dot(a, cross(b, c));
      expect(volume).toBeGreaterThan(-1e-9);
      area += 2 * Math.atan2(volume, 1 + dot(a, b) + dot(b, c) + dot(c, a));
    }
    expect(area).toBeCloseTo(2 * Math.PI, 1);
  });

  it("is denser for a narrow lobe", () => {
    const first = (alpha: number): number =>
      dot(POLES[1] as Vec3, lobeGrid(POLES[1] as Vec3, 1, alpha, 28, 48).directions[1] as Vec3);
    expect(Math.acos(first(0.05))).toBeLessThan(0.02);
    expect(Math.acos(first(0.05))).toBeLessThan(Math.acos(first(1)));
  });
});

describe("the disc", () => {
  it("has cells of equal solid angle that cover the hemisphere", () => {
    const { directions, solidAngle } = disc(64, -1);
    expect(directions.length * solidAngle).toBeCloseTo(2 * Math.PI, 1);
    const projected = directions.reduce((sum, d) => sum - d[2] * solidAngle, 0);
    expect(projected).toBeCloseTo(Math.PI, 1);
    for (const d of directions) expect(Math.hypot(...d)).toBeCloseTo(1, 9);
  });

  it("knows where a direction lies", () => {
    const { directions, cells, size } = disc(16, 1);
    directions.forEach((d, i) => {
      const p = onDisc(d);
      const cell = cells[i] ?? 0;
      expect(p.x).toBeCloseTo((2 * ((cell % size) + 0.5)) / size - 1, 6);
      expect(p.y).toBeCloseTo(1 - (2 * (Math.floor(cell / size) + 0.5)) / size, 6);
    });
  });
});

it("directions and angles are one another's inverse", () => {
  const { theta, phi } = angles(direction(1.1, -2.5));
  expect([theta, phi]).toEqual([expect.closeTo(1.1, 9), expect.closeTo(-2.5, 9)]);
  expect(dot(mirrored(direction(0.7, 1)), direction(0.7, 1 + Math.PI))).toBeCloseTo(1, 9);
});

it("the plane of incidence has the mirror's side at positive angles", () => {
  const { angle, directions } = planeOfIncidence(0.4, 360);
  const mirror = mirrored(direction(0.8, 0.4));
  const best = directions.reduce((b, d, i) => (dot(d, mirror) > dot(directions[b] as Vec3, mirror) ? i : b), 0);
  expect(angle[best]).toBeCloseTo(0.8, 1);
});
