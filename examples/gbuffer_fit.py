"""Maps from pictures
==================

Finds base colour, metallic and roughness of every pixel from pictures under eight lights.

::

    python examples/gbuffer_fit.py --out fit.png

The pictures are those of a material with all bounces and 1 % of noise. They are fitted twice, with all bounces and with one:
what a model leaves out ends up in the maps.
"""

import argparse
import time
from pathlib import Path

import torch
from gbuffer import GBuffer, Maps, gbuffer, side_by_side, true_maps
from torch import Tensor

import torchms as ms
from torchms.render.images import write_picture
from torchms.shading import shade


def lights(position: Tensor, n: int = 8) -> tuple[Tensor, Tensor]:
    """Unit vectors (n, rows, columns, 3) to point lights, low and high, and the irradiance (n, rows, columns, 1)."""
    turn, lift = 2.4 * torch.arange(n), torch.linspace(0.15, 1.3, n)
    at = 3 * torch.stack([lift.cos() * turn.cos(), lift.sin(), lift.cos() * turn.sin()], -1)
    to = at[:, None, None] - position
    distance = to.norm(dim=-1, keepdim=True)
    return to / distance, 20 / distance**2


def pictures(maps: Maps, g: GBuffer, bounces: str) -> Tensor:
    """Radiance (lights, *maps, 3): the lights lead, so maps and G-buffer broadcast as they are."""
    material = ms.compile(ms.MetallicRoughness(*maps, bounces=bounces), verbose=False)
    light, irradiance = lights(g.position)
    if maps.metallic.ndim > 2:  # several of them
        light, irradiance = light[:, None], irradiance[:, None]
    return shade(material, g.normal, g.view, light) * irradiance


def fit(target: Tensor, g: GBuffer, bounces: str, steps: int) -> tuple[Maps, list[float]]:
    """Maps whose pictures are the target's, and the loss of each step.

    Every pixel starts twice, as paint and as metal, and the better one is kept: a gradient does not lead from one to the other.
    """
    raw = torch.zeros(2, *g.normal.shape[:2], 5)
    raw[0, ..., 3], raw[1, ..., 3] = -2.0, 2.0
    raw.requires_grad_()
    adam = torch.optim.Adam([raw], lr=0.1, betas=(0.9, 0.99))
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(adam, steps, eta_min=0.005)
    losses = []

    def maps() -> Maps:
        # Every number of a map within its range, whatever is learned.
        inside = torch.sigmoid(raw)
        return Maps(inside[..., :3], inside[..., 3], 0.1 + 0.9 * inside[..., 4])

    def errors() -> Tensor:
        error = (pictures(maps(), g, bounces) - target[:, None]) / (target[:, None] + 0.05)
        return (error * error).mean((0, -1))

    for _ in range(steps):
        adam.zero_grad()
        each = errors()
        each.mean().backward()
        adam.step()
        decay.step()
        losses.append(float(each.detach().amin(0).mean()))
    with torch.no_grad():
        each = errors()
        first = each[0] < each[1]
        kept = (torch.where(first if x.ndim == 3 else first[..., None], x[0], x[1]) for x in maps())
        return Maps(*kept), losses


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=48, help="pixels along either side")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--out", type=Path, help="picture (.png) of truth, all bounces, one bounce")
    parser.add_argument("--force", action="store_true", help="overwrite the picture")
    options = parser.parse_args()
    generator = torch.Generator().manual_seed(0)
    g, truth = gbuffer(options.size), true_maps(options.size)
    with torch.no_grad():
        clean = pictures(truth, g, "all")
        target = clean * (1 + 0.01 * torch.randn(clean.shape, generator=generator))
    shown = [[target[0], *truth]]
    print(f"{'mean error of':>15} {'base colour':>12} {'metallic':>9} {'roughness':>10} {'loss':>9} {'seconds':>8}")
    names = {"all": "all bounces", "one": "one bounce"}
    for bounces in names:
        start = time.perf_counter()
        found, losses = fit(target, g, bounces, options.steps)
        seconds = time.perf_counter() - start
        errors = [float((a - b).abs().mean()) for a, b in zip(found, truth, strict=True)]
        print(
            f"{names[bounces]:>15} {errors[0]:12.4f} {errors[1]:9.4f} {errors[2]:10.4f} {losses[-1]:9.2e} {seconds:8.1f}"
        )
        with torch.no_grad():
            shown.append([pictures(found, g, bounces)[0], *found])
    if options.out is not None:
        write_picture(options.out, side_by_side(shown), force=options.force)
        print(f"{options.out}: light 1, base colour, metallic, roughness; truth, all bounces, one bounce")


if __name__ == "__main__":
    main()
