"""A measured surface beside what was fitted to it: spheres, and lobes in the plane of incidence."""

import io
import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from torchms.measured.fit import INCIDENCE, RELIABLE, Comparison
from torchms.measured.rgl import MeasuredBRDF
from torchms.render.images import srgb
from torchms.shading.frame import ShadingFrame

Lobe = Callable[[Tensor, Tensor], Tensor]
"""view, light (n, 3): f · cos θ_light (n, C)."""
LIGHT = math.radians(40)
SHOWN = INCIDENCE[1::2] + INCIDENCE[-1:]
STYLES: dict[str, dict[str, Any]] = {
    "measured": {"color": "black", "linewidth": 1.6},
    "all bounces": {"color": "#1f5fa8", "linewidth": 1.3},
    "one bounce": {"color": "#c4572b", "linewidth": 1.3, "linestyle": "--"},
}


@torch.no_grad()
def sphere(lobe: Lobe, size: int) -> Tensor:
    """(size, size, 3) linear, under a light from 40° above the camera; white where there is none."""
    centre = ((torch.arange(size, dtype=torch.float64) + 0.5) / size * 2 - 1) * 1.04
    y, x = torch.meshgrid(-centre, centre, indexing="ij")
    inside = x * x + y * y < 1
    x, y = x[inside], y[inside]
    frame = ShadingFrame(torch.stack([x, y, (1 - x * x - y * y).sqrt()], -1))
    towards = [torch.tensor(w, dtype=torch.float64) for w in ((0, 0, 1), (0, math.sin(LIGHT), math.cos(LIGHT)))]
    view, light = (frame.to_local(w.expand(len(x), 3)) for w in towards)
    picture = torch.full((size, size, 3), math.nan, dtype=torch.float64)
    picture[inside] = lobe(view, light)
    return picture


@torch.no_grad()
def picture(brdf: MeasuredBRDF, comparisons: Sequence[Comparison], size: int = 200) -> bytes:
    """A PNG. Needs matplotlib."""
    from matplotlib.figure import Figure

    lobes: dict[str, Lobe] = {"measured": brdf.double()}
    lobes |= {f"{c.bounces} bounce{'s' * (c.bounces == 'all')}": c.surface for c in comparisons}
    figure = Figure(figsize=(13, 4.6), dpi=100, layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=(1, 1.15))
    top, below = parts
    images = {name: sphere(lobe, size) for name, lobe in lobes.items()}
    exposure = 0.9 / float(images["measured"].nan_to_num(0).amax(-1).reshape(-1).quantile(0.97))
    axes = top.subplots(1, 2 * len(lobes) - 1)
    for axis, (name, image) in zip(axes, images.items(), strict=False):
        axis.imshow(srgb(torch.where(image.isnan(), 1.0, image * exposure)).numpy())
        axis.set_title(name, fontsize=9)
    for axis, c in zip(axes[len(lobes) :], comparisons, strict=True):
        name = f"{c.bounces} bounce{'s' * (c.bounces == 'all')}"
        difference = ((images[name] - images["measured"]) * exposure).mean(-1)
        axis.imshow(difference.numpy(), cmap="RdBu_r", vmin=-0.2, vmax=0.2)
        axis.set_title(f"{name} − measured\nresidual {100 * c.rms():.1f} %", fontsize=9)
    for axis in axes:
        axis.axis("off")
    for axis, degrees in zip(below.subplots(1, len(SHOWN)), SHOWN, strict=True):
        _lobes(axis, lobes, degrees)
    content = io.BytesIO()
    figure.savefig(content, format="png", metadata={"Software": None})
    return content.getvalue()


def _lobes(axis: Any, lobes: dict[str, Lobe], degrees: float) -> None:
    """In the plane of incidence, mean of the channels."""
    theta = torch.linspace(-RELIABLE, RELIABLE, 301, dtype=torch.float64)
    angle = theta.deg2rad()
    light = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1)
    at = math.radians(degrees)
    view = torch.tensor([-math.sin(at), 0.0, math.cos(at)], dtype=torch.float64).expand_as(light)
    for name, lobe in lobes.items():
        axis.plot(theta, lobe(view, light).mean(-1), label=name, **STYLES[name])
    axis.set_title(f"view at {degrees:g}°", fontsize=9)
    axis.set_xlabel("light [°], mirror direction to the right", fontsize=8)
    axis.set_ylim(0, None)
    axis.tick_params(labelsize=8)
    axis.spines[["top", "right"]].set_visible(False)
    if degrees == SHOWN[0]:
        axis.set_ylabel("f cos θ [1/sr]", fontsize=8)
        axis.legend(frameon=False, fontsize=8)
