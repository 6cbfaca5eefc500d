"""What of a measured surface a metal-roughness material can say, with all bounces and with one."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchms.bsdfs.metallic_roughness import MetallicRoughness
from torchms.maths.frame import Vec3, join, reflect, split
from torchms.measured.least_squares import least_squares

RELIABLE = 75.0
"""Angle [degrees] above which nothing is compared: measurements there are unreliable."""
INCIDENCE = (5.0, 20.0, 35.0, 50.0, 65.0)
"""Angles of the view [degrees]."""
OVER, ABOUT = (14, 16), (14, 12)
"""Directions over the hemisphere and about the mirror direction: along the angle from the middle, and around it."""
NAMES = ("base red", "base green", "base blue", "metallic", "roughness", "ior")
LOW = (0.0, 0.0, 0.0, 0.0, 0.05, 1.0)
HIGH = (1.0, 1.0, 1.0, 1.0, 1.0, 2.5)
START = {"metallic": 0.2, "ior": 1.5}
STARTS = (0.2, 0.5, 0.8)
"""Roughnesses that a fit sets out from; the best of them is kept."""
STEPS = 40


class Samples(NamedTuple):
    """view and light (n, 3); angle (n) of the view [degrees]; near (n): whether it is one about the mirror direction."""

    view: Tensor
    light: Tensor
    angle: Tensor
    near: Tensor


def samples() -> Samples:
    """For each angle of the view as many directions of light over the hemisphere as about the mirror direction, float64.

    Over the hemisphere they are even in solid angle times cosine. About the mirror direction they are those of half vectors
    tilted by 0.3° to 40°, even in the logarithm. One half of the azimuths: isotropic surfaces mirror the other.
    """
    most = math.radians(RELIABLE)
    views, lights, angles, near = [], [], [], []
    for degrees in INCIDENCE:
        view = _polar(torch.tensor(math.radians(degrees)).double(), torch.tensor(0.0).double())
        for count, close in ((OVER, False), (ABOUT, True)):
            along, around = ((torch.arange(n, dtype=torch.float64) + 0.5) / n for n in count)
            if close:
                tilt = torch.exp(math.log(0.3) + along * math.log(40 / 0.3)).deg2rad()
            else:
                tilt = torch.asin(math.sin(most) * along.sqrt())
            d = _polar(tilt[:, None], math.pi * around)
            light = join(reflect(Vec3(*view.unbind(-1)), split(d))) if close else d
            light = light.reshape(-1, 3)
            light = light[light[:, 2] > math.cos(most)]
            views.append(view.expand_as(light))
            lights.append(light)
            angles.append(torch.full((len(light),), degrees, dtype=torch.float64))
            near.append(torch.full((len(light),), close))
    return Samples(*(torch.cat(parts) for parts in (views, lights, angles, near)))


def _polar(theta: Tensor, phi: Tensor) -> Tensor:
    return join(Vec3(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()))


def material(x: Tensor, bounces: str, diffuse: str) -> MetallicRoughness:
    """The surface of the parameters `NAMES`."""
    return MetallicRoughness(x[:3], x[3], x[4], ior=x[5], diffuse=diffuse, bounces=bounces)


@dataclass(frozen=True)
class Comparison:
    """A fit with one model. values, errors (6,): of `NAMES`, one standard error each, NaN where a value was held or is at a
    bound. relative (n, 3): residuals, (model − measured) / (measured + its mean at that angle)."""

    bounces: str
    diffuse: str
    values: Tensor
    errors: Tensor
    relative: Tensor
    at: Samples

    @property
    def surface(self) -> MetallicRoughness:
        """The material that was found, float64."""
        return material(self.values, self.bounces, self.diffuse)

    def rms(self, where: Tensor | None = None) -> float:
        """Root mean square of the relative residuals, over the rows `where` a mask (n) is true, or all."""
        chosen = self.relative if where is None else self.relative[where]
        return float(chosen.square().mean().sqrt())


def steps() -> int:
    """How often `advance` is called at most for each model."""
    return len(STARTS) * STEPS


@torch.no_grad()
def fitted(
    brdf: nn.Module,
    bounces: str,
    *,
    diffuse: str = "rough",
    hold: Mapping[str, float] | None = None,
    at: Samples | None = None,
    advance: Callable[[int], None] = lambda steps: None,
) -> Comparison:
    """The `MetallicRoughness` nearest to `brdf`: least squares of relative residuals over `samples`, view and light ≤ 75°.

    brdf: a `MeasuredBRDF`, or what is called like one and has three channels. bounces: "all" or "one"; diffuse: "rough" or
    "lambert". hold: numbers of metallic or ior that are not fitted. advance: is told of every step.
    """
    hold = hold or {}
    at = samples() if at is None else at
    free = torch.tensor([name not in hold for name in NAMES])
    fixed = torch.tensor([hold.get(name, math.nan) for name in NAMES], dtype=torch.float64)
    measured = brdf.double()(at.view, at.light)
    scale = 1 / (measured.clamp_min(0) + _means(measured, at))

    def residuals(x: Tensor) -> Tensor:
        numbers = fixed.masked_scatter(free, x)
        return ((material(numbers, bounces, diffuse)(at.view, at.light) - measured) * scale).reshape(-1)

    colour = (measured * math.pi / at.light[:, 2:])[~at.near].median(0).values.clamp(0.02, 0.98)
    low, high = (torch.tensor(bound, dtype=torch.float64)[free] for bound in (LOW, HIGH))
    found = []
    for roughness in STARTS:
        start = torch.cat([colour, torch.tensor([START["metallic"], roughness, START["ior"]]).double()])[free]
        found.append(least_squares(residuals, start, low, high, steps=STEPS, advance=advance))
    best = min(found, key=lambda fit: fit.rms)
    values, errors = fixed.masked_scatter(free, best.values), torch.full_like(fixed, math.nan)
    errors[free] = best.errors
    relative = residuals(best.values).reshape(-1, 3)
    return Comparison(bounces, diffuse, values, errors, relative, at)


def _means(measured: Tensor, at: Samples) -> Tensor:
    """Of each row: the mean over the hemisphere at its angle, of its channel."""
    found = torch.zeros_like(measured)
    for degrees in INCIDENCE:
        here = at.angle == degrees
        found[here] = measured[here & ~at.near].mean(0)
    return found
