"""Small pictures for the docs, about three minutes of one core: python -m tools.pictures [folder]."""

import math
import sys
import tempfile
from pathlib import Path

import torch
from torch import Tensor

from torchms.cli.options import RenderOptions
from torchms.cli.render import run_render
from torchms.render.images import write_picture

MIRROR = "RoughConductor(GGX(1.0), Ideal(), {})"
ALL_BOUNCES = "Bidirectional(Invariance(), max_order=12)"


def studio(rows: int = 1024) -> Tensor:
    """A lat-long map (rows, 2 rows, 3): a dim room with three soft boxes, over a floor of tiles."""
    theta = ((torch.arange(rows) + 0.5) / rows * math.pi)[:, None]
    phi = ((torch.arange(2 * rows) + 0.5) / rows * math.pi)[None]
    x, y, z = -theta.sin() * phi.sin(), theta.cos().expand(-1, 2 * rows), theta.sin() * phi.cos()
    wall = (0.18 + 0.25 * y.clamp_min(0))[..., None] * torch.tensor([0.85, 0.95, 1.1])
    # Tiles on a floor one unit below.
    scale = 1 / y.clamp_max(-0.02).abs()
    tile = ((x * scale * 1.5).floor() + (z * scale * 1.5).floor()) % 2
    fade = (-4 * y).clamp(0, 1)
    floor = (0.08 + 0.55 * tile * fade + 0.12 * (1 - fade))[..., None] * torch.tensor([1.0, 0.9, 0.78])
    texels = torch.where((y < 0)[..., None], floor, wall)
    for middle, half, colour in (
        ((-0.7, 0.75, 0.45), 0.30, (9.0, 8.6, 8.0)),
        ((0.9, 0.45, 0.35), 0.18, (5.0, 5.6, 7.0)),
        ((0.3, 1.0, -0.5), 0.22, (6.0, 4.2, 2.8)),
    ):
        n = torch.nn.functional.normalize(torch.tensor(middle), dim=0)
        near = x * n[0] + y * n[1] + z * n[2]
        side = torch.nn.functional.normalize(torch.stack([-n[2], torch.zeros(()), n[0]]), dim=0)
        above = torch.linalg.cross(n, side)
        u = (x * side[0] + y * side[1] + z * side[2]) / near.clamp_min(1e-3)
        v = (x * above[0] + y * above[1] + z * above[2]) / near.clamp_min(1e-3)
        box = (near > 0) & (u.abs() < half) & (v.abs() < half)
        texels = torch.where(box[..., None], torch.tensor(colour), texels)
    return texels


def pictures(folder: Path, light: Path) -> list[RenderOptions]:
    """What is rendered into `folder`; `light` is the map of `studio`."""
    size = {"width": 200, "height": 200, "force": True}
    furnace = {"scene": "sphere", "light": "constant", "intensity": 0.5, "samples": 48, "eye": (0.0, 0.0, 3.4), **size}
    lit = {"scene": "sphere", "light": str(light), "tone": "filmic", **size}
    return [
        RenderOptions(out=str(folder / "furnace_single_bounce.png"), bsdf=MIRROR.format("SingleBounce()"), **furnace),
        RenderOptions(out=str(folder / "furnace_all_bounces.png"), bsdf=MIRROR.format(ALL_BOUNCES), **furnace),
        RenderOptions(
            out=str(folder / "gold.png"),
            bsdf="RoughConductor(GGX(0.35), Conductor.metal('Au'))",
            samples=256,
            **lit,
        ),
        RenderOptions(
            out=str(folder / "glass.png"),
            bsdf="RoughDielectric(GGX(0.1), Dielectric(1.5), HeightWalk(4))",
            samples=48,
            inner=6,
            **lit,
        ),
    ]


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/images")
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        light = Path(name) / "studio.exr"
        write_picture(light, studio())
        for options in pictures(folder, light):
            run_render(options)


if __name__ == "__main__":
    main()
