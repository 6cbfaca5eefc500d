"""A rough profile in the plane, light that bounces on it, and drawings of both for the pages of the theory."""

import itertools
import math
from typing import Any

import numpy as np

INK, LIGHT, OTHER, SKY = "#33373d", "#d1495b", "#1b6ca8", "#edae49"


class Profile:
    """Heights z over x in [0, 10], joined by straight facets; a sum of waves with random phases."""

    def __init__(self, seed: int, slope: float = 0.8, facets: int = 70) -> None:
        rng = np.random.default_rng(seed)
        self.x = np.linspace(0.0, 10.0, facets + 1)
        waves = 2 * np.pi * np.arange(2, 13) / 10
        size = np.exp(-((waves / 4.5) ** 2)) * rng.normal(size=11)
        heights = (size * np.sin(waves * self.x[:, None] + rng.uniform(0, 2 * np.pi, 11))).sum(1)
        self.z = heights * slope / np.std(np.diff(heights) / np.diff(self.x))
        edges = np.diff(np.stack([self.x, self.z], -1), axis=0)
        self.normals = np.stack([-edges[:, 1], edges[:, 0]], -1) / np.linalg.norm(edges, axis=1)[:, None]

    @property
    def middles(self) -> np.ndarray:
        """(facets, 2) the centres of the facets."""
        points = np.stack([self.x, self.z], -1)
        return (points[1:] + points[:-1]) / 2

    def hit(self, origin: np.ndarray, d: np.ndarray) -> tuple[float, int] | None:
        """Distance to the first facet along d, and its number."""
        a, b = (np.stack([self.x[s], self.z[s]], -1) for s in (slice(None, -1), slice(1, None)))
        edge, to = b - a, a - origin
        cross = d[0] * edge[:, 1] - d[1] * edge[:, 0]
        cross = np.where(np.abs(cross) < 1e-12, 1e-12, cross)
        t = (to[:, 0] * edge[:, 1] - to[:, 1] * edge[:, 0]) / cross
        s = (to[:, 0] * d[1] - to[:, 1] * d[0]) / cross
        t = np.where((t > 1e-6) & (s >= 0) & (s < 1), t, np.inf)
        i = int(t.argmin())
        return (float(t[i]), i) if np.isfinite(t[i]) else None

    def path(self, origin: np.ndarray, d: np.ndarray, eta: float | None = None, flips: str = "") -> list[np.ndarray]:
        """Corners of a light path; at bounce k it is refracted where `flips[k]` is "t", and reflected elsewhere."""
        corners = [origin]
        for k in range(12):
            found = self.hit(origin, d)
            if found is None:
                break
            origin = origin + found[0] * d
            corners.append(origin)
            n = self.normals[found[1]]
            n = n if n @ d < 0 else -n
            if k < len(flips) and flips[k] == "t" and eta is not None:
                ratio = 1 / eta if n[1] > 0 else eta
                inside = 1 - ratio**2 * (1 - (n @ d) ** 2)
                if inside < 0:
                    return corners
                d = ratio * d + (-ratio * (n @ d) - math.sqrt(inside)) * n
            else:
                d = d - 2 * (n @ d) * n
        corners.append(origin + 1.6 * d)
        return corners

    def draw(self, axis: Any, low: float | None = None) -> None:
        """The surface, filled below."""
        low = self.z.min() - 0.4 if low is None else low
        axis.fill_between(self.x, self.z, low, color="#eceff3", linewidth=0)
        axis.plot(self.x, self.z, color=INK, linewidth=1.6)
        axis.set_aspect("equal")
        axis.axis("off")


def draw_path(axis: Any, corners: list[np.ndarray], names: bool = True, colour: str = LIGHT) -> None:
    """Arrows from corner to corner, d_0, d_1, … beside them, the bounces numbered."""
    for k, (a, b) in enumerate(itertools.pairwise(corners)):
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
        axis.annotate("", xy=b, xytext=a, arrowprops=arrow)
        if names:
            middle, along = (a + b) / 2, (b - a) / np.linalg.norm(b - a)
            axis.text(
                *(middle + 0.2 * np.array([along[1], -along[0]])), f"$d_{k}$", color=colour, ha="center", va="center"
            )
    for k, corner in enumerate(corners[1:-1], start=1):
        axis.plot(*corner, "o", color=colour, markersize=11)
        axis.text(*corner, str(k), color="white", ha="center", va="center", fontsize=8, weight="bold")
