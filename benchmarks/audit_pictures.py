"""What `audit.py` fits: pictures of a gold sphere under eight lights, with all bounces, and the roughness and F0 that a formula
finds in them."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import torch
from audit_formulas import Formula
from torch import Tensor

import torchms as ms
from torchms.fresnel import Conductor
from torchms.measured.least_squares import least_squares
from torchms.sampling.stream import Stream
from torchms.shading import ShadingFrame

LEAST_COSINE = 0.05
"""Of view and light with the normal in the rows that are fitted."""
ORDERS = 8


class Rows(NamedTuple):
    """One row for each pixel and light: view and light (n, 3) in the local frame."""

    view: Tensor
    light: Tensor


def sphere(size: int) -> Rows:
    """The pixels of a sphere in parallel projection, and eight lights from 10° to 80° off the axis of the camera."""
    centre = (torch.arange(size, dtype=torch.float64) + 0.5) / size * 2 - 1
    y, x = torch.meshgrid(-centre, centre, indexing="ij")
    inside = x * x + y * y < 1
    x, y = x[inside], y[inside]
    normal = torch.stack([x, y, (1 - x * x - y * y).sqrt()], -1)
    k = torch.arange(8, dtype=torch.float64)
    theta, phi = torch.deg2rad(10 + 10 * k), 2.4 * k
    lights = torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], -1)
    frame = ShadingFrame(normal[:, None])
    view, light = frame.to_local(torch.tensor([0.0, 0.0, 1.0]).double()), frame.to_local(lights)
    lit = (light[..., 2] > LEAST_COSINE) & (view[..., 2] > LEAST_COSINE)
    return Rows(view.expand_as(light)[lit], light[lit])


def gold_f0() -> Tensor:
    return Conductor.metal("Au").double()(torch.ones((), dtype=torch.float64))


@torch.no_grad()
def photographs(rows: Rows, r: float, count: int, paths: int) -> Iterator[Tensor]:
    """Radiance (n, 3) under light of unit irradiance, `count` times with other random numbers."""
    exact = ms.RoughConductor(ms.GGX(r * r), Conductor.metal("Au"), ms.Bidirectional(ms.Invariance(), ORDERS))
    first = ms.RoughConductor(ms.GGX(r * r), Conductor.metal("Au"), ms.SingleBounce()).double()(*rows)
    fast = ms.compile(exact, verbose=False)
    for seed in range(count):
        orders = fast.orders(rows.view.float(), rows.light.float(), Stream(seed, paths, "sobol")).double()
        # One bounce is a closed form.
        yield first + orders[:, 1:].sum(1)


def fitted(formula: Formula, rows: Rows, picture: Tensor) -> dict[str, Any]:
    """Roughness and F0 that fit best; residuals are relative to the value and the mean together."""
    weight = 1 / (picture + picture.mean())
    n = len(picture)

    def residuals(x: Tensor) -> Tensor:
        value = formula(rows.view, rows.light, x[:1].expand(n, 1), x[1:].expand(n, 3))
        return ((value - picture) * weight).reshape(-1)

    low = torch.tensor([0.05, 0.0, 0.0, 0.0], dtype=torch.float64)
    high = torch.ones(4, dtype=torch.float64)
    fit = least_squares(residuals, torch.tensor([0.5, 0.8, 0.8, 0.8], dtype=torch.float64), low, high)
    return {"roughness": float(fit.values[0]), "f0": fit.values[1:].tolist(), "residual": fit.rms}
