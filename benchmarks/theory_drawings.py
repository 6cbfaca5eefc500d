"""Drawings for the pages of the theory: what masks what, a path and its directions, a path through glass."""

import itertools

import numpy as np
import torch
from matplotlib.figure import Figure
from theory_profile import INK, LIGHT, OTHER, SKY, Profile, draw_path

from torchms import GGX


def figure(width: float, height: float) -> Figure:
    """An empty figure [inches]."""
    return Figure(figsize=(width, height), dpi=110, layout="constrained")


def masking() -> Figure:
    """Facets that face a direction, those of them that are hidden; and the area that facets show to any direction."""
    drawn = figure(9, 3.4)
    left, right = drawn.subplots(1, 2, width_ratios=(1.9, 1))
    profile, w = Profile(4), np.array([-np.sin(1.15), np.cos(1.15)])
    profile.draw(left)
    points = np.stack([profile.x, profile.z], -1)
    for i, (middle, normal) in enumerate(zip(profile.middles, profile.normals, strict=True)):
        if normal @ w <= 0:
            continue
        seen = profile.hit(middle + 1e-4 * normal, w) is None
        left.plot(*points[i : i + 2].T, color=SKY if seen else OTHER, linewidth=4, solid_capstyle="butt")
        if seen and i % 2 == 0:
            left.plot(*np.stack([middle, middle + 1.1 * w]).T, color=SKY, linewidth=0.8)
    for colour, label in ((SKY, "seen from w"), (OTHER, "face w, but hidden"), (INK, "face away")):
        left.plot([], [], color=colour, linewidth=4 if colour != INK else 1.6, label=label)
    left.legend(loc="upper center", fontsize=8, frameon=False, ncols=3)
    left.set(xlim=(-0.6, 5.6), ylim=(profile.z.min() - 0.4, profile.z.max() + 1.2))
    theta = torch.linspace(0, torch.pi, 360)
    direction = torch.stack([theta.sin(), torch.zeros_like(theta), theta.cos()], -1)
    for alpha, style in ((0.25, ":"), (0.5, "--"), (1.0, "-")):
        area = (1 + GGX(alpha).Lambda(direction)) * direction[:, 2]
        right.plot(theta.rad2deg(), area, style, color=OTHER, label=f"GGX, α = {alpha:g}")
    right.plot(theta.rad2deg(), direction[:, 2].clamp_min(0), color=INK, linewidth=1, label="flat ground")
    right.axvline(90, color=INK, linewidth=0.6)
    right.text(92, 0.92, "below the horizon", fontsize=8)
    right.set(xlabel="angle of w from the normal [°]", ylabel="area that facets show, σ(w)", ylim=(0, 1.02))
    right.legend(fontsize=8, frameon=False, loc="center right")
    return drawn


def path() -> Figure:
    """A path of three bounces and its directions."""
    drawn = figure(7.2, 2.9)
    axis = drawn.subplots()
    profile, d = Profile(27, slope=1.4), np.array([np.sin(0.3), -np.cos(0.3)])
    corners = found(profile, d, "", 3)
    profile.draw(axis)
    draw_path(axis, corners)
    axis.set_ylim(profile.z.min() - 0.4, max(corners[0][1], corners[-1][1]) + 0.1)
    return drawn


def glass() -> Figure:
    """A path that enters a bump of glass, leaves it on its other side, and is thrown up by the next facet."""
    drawn = figure(7.2, 2.9)
    axis = drawn.subplots()
    profile, d = Profile(28, slope=1.4), np.array([np.sin(1.25), -np.cos(1.25)])
    for colour, flips, bounces in ((LIGHT, "tt", 3), (OTHER, "t", 1)):
        draw_path(axis, found(profile, d, flips, bounces), names=False, colour=colour)
    profile.draw(axis, profile.z.min() - 1.6)
    axis.set_ylim(profile.z.min() - 1.6, profile.z.max() + 1.5)
    return drawn


def found(profile: Profile, d: np.ndarray, flips: str, bounces: int) -> list[np.ndarray]:
    """The path of so many bounces, `flips` of them refractions, whose shortest leg is the longest; it comes down along d."""
    paths = []
    for x in np.linspace(1.5, 8.5, 400):
        first = profile.hit(np.array([x, profile.z.max() + 0.1]) - 6 * d, d)
        if first is None:
            continue
        start = np.array([x, profile.z.max() + 0.1]) - 6 * d + max(first[0] - 1.6, 0.0) * d
        corners = profile.path(start, d, 1.5, flips)
        if len(corners) == bounces + 2 and all(0.3 < c[0] < 9.7 for c in corners):
            legs = [float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(corners)]
            paths.append((min(legs), -x, corners))
    if not paths:
        raise RuntimeError(f"no path of {bounces} bounces; take another seed of the profile")
    return max(paths, key=lambda entry: entry[:2])[2]
