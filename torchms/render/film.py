"""Many camera rays a pixel, in blocks of bounded memory, and what the pixels' standard errors are."""

import os
from dataclasses import dataclass

import torch
from torch import Tensor

from torchms.cli.progress import progress_bar
from torchms.evaluation.workers import Workers
from torchms.render.camera import Camera
from torchms.render.paths import Scene, radiance
from torchms.sampling.uniforms import draw, generator_for

BLOCK_PIXELS = 1024
BLOCK_RAYS = 8192
"""Camera rays that are followed at a time."""


@dataclass(frozen=True)
class Picture:
    """Mean radiance of each pixel and its standard error, (rows, columns, 3) float32, linear sRGB."""

    mean: Tensor
    stderr: Tensor


@torch.no_grad()
def render(
    scene: Scene,
    camera: Camera,
    *,
    width: int = 256,
    height: int = 256,
    samples: int = 16,
    seed: int = 0,
    progress: bool | None = None,
    threads: int | None = None,
) -> Picture:
    """The picture that `camera` takes, with `samples` rays a pixel, uniform over its square.

    It depends on these numbers only, not on the threads. Raises ValueError if a size is less than 1 or there are
    fewer than 2 samples, which have no standard error, if a parameter of the BSDF is a map, or for glass in a mesh
    that is not closed.
    """
    for name, value, least in (("width", width, 1), ("height", height, 1), ("samples", samples, 2)):
        if value < least:
            raise ValueError(f"{name} must be at least {least}; got {value}.")
    if scene.inner < 1:
        raise ValueError(f"inner must be at least 1 segment inside the glass; got {scene.inner}.")
    if any(shape.numel() != 1 for shape in scene.bsdf.parameter_batch_shapes()):
        raise ValueError("render(scene=...) takes a BSDF with scalar parameters; got a per-pixel map.")
    if scene.bsdf.n_channels not in (1, 3):
        raise ValueError(f"render(scene=...) takes a BSDF of 1 or 3 channels; got {scene.bsdf.n_channels}.")
    if scene.transmits and not scene.shape.is_closed:
        raise ValueError(
            "a dielectric needs a closed mesh, which has an inside; this one has open edges. "
            "Close it, or use the scene slab or sphere."
        )
    n = width * height
    starts = range(0, n, BLOCK_PIXELS)

    def block(start: int) -> tuple[Tensor, Tensor]:
        pixel = torch.arange(start, min(start + BLOCK_PIXELS, n))
        generator = generator_for((seed * 1_000_003 + start) % 2**63)
        sums = torch.zeros(2, len(pixel), 3, dtype=torch.float64)
        step = max(1, BLOCK_RAYS // len(pixel))
        for first in range(0, samples, step):
            size = min(step, samples - first)
            inside = draw((size, len(pixel)), 1, 2, generator=generator, dtype=torch.float64)[..., 0, :]
            x = ((pixel % width) + inside[..., 0]) / width
            y = (torch.div(pixel, width, rounding_mode="floor") + inside[..., 1]) / height
            origin, direction = camera.rays(x.reshape(-1), y.reshape(-1), width / height)
            value = radiance(scene, origin, direction, generator).reshape(size, len(pixel), 3)
            sums[0] += value.sum(0)
            sums[1] += (value * value).sum(0)
            advance(size * len(pixel))
        return sums[0], sums[1]

    with (
        progress_bar("camera rays", n * samples, progress) as advance,
        Workers(threads or min(len(starts), os.cpu_count() or 1)) as workers,
    ):
        total, squares = (torch.cat(parts) for parts in zip(*workers.map(block, starts), strict=True))
    mean = total / samples
    stderr = ((squares / samples - mean * mean).clamp_min(0) / (samples - 1)).sqrt()
    return Picture(*(part.reshape(height, width, 3).float() for part in (mean, stderr)))
