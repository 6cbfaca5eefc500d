"""A G-buffer under a sky
======================

Puts a G-buffer under an environment map, by importance sampling of the material and of the map in every pixel.

::

    python examples/relight.py --out relit.png
    python examples/relight.py --environment sky.exr --samples 64 --out relit.png

Draws it with all bounces and with one, and says how much light one bounce loses.
"""

import argparse
from pathlib import Path

import torch
from gbuffer import GBuffer, gbuffer, side_by_side, true_maps
from torch import Tensor

import torchms as ms
from torchms.render import Environment
from torchms.render.images import read_picture, write_picture
from torchms.shading import sample, shade


def sky(rows: int = 32) -> Tensor:
    """(rows, 2 rows, 3): a sun in a blue sky above a brown ground."""
    theta = ((torch.arange(rows) + 0.5) * (torch.pi / rows))[:, None, None].expand(rows, 2 * rows, 1)
    up = theta.cos()
    colour = torch.where(up > 0, torch.tensor([0.4, 0.6, 1.0]) * (1.2 - up), torch.tensor([0.25, 0.2, 0.15]))
    colour[rows // 5, rows // 2 : rows // 2 + 2] = torch.tensor([120.0, 110.0, 90.0])
    return colour


def relit(material: ms.BSDF, g: GBuffer, world: Environment, n: int, generator: torch.Generator) -> Tensor:
    """Radiance (rows, columns, 3) of each pixel: n directions of the material, n of the map, by the balance heuristic."""
    pixels = g.normal.shape[:-1]

    def density(light: Tensor) -> Tensor:
        # One direction a row is what an environment takes.
        return world.pdf(light.reshape(-1, 3)).to(light.dtype).reshape(light.shape[:-1])

    def arriving(light: Tensor) -> Tensor:
        return world.radiance(light.reshape(-1, 3)).to(light.dtype).reshape(light.shape)

    def material_density(light: Tensor) -> Tensor:
        frame = ms.shading.ShadingFrame(g.normal)
        return material.pdf(frame.to_local(g.view), frame.to_local(light))

    # What `sample` returns goes into `shade` as it is: the n samples lead.
    drawn = sample(material, g.normal, g.view, material.uniforms(pixels, n, generator=generator))
    value = shade(material, g.normal, g.view, drawn.light)
    weight = 1 / (drawn.pdf + density(drawn.light))
    total = torch.where(drawn.pdf > 0, weight, 0.0)[..., None] * value * arriving(drawn.light)
    u = torch.rand(n * pixels.numel(), 2, generator=generator)
    chosen = world.sample(u)
    light = chosen.direction.float().reshape(n, *pixels, 3)
    value = shade(material, g.normal, g.view, light)
    weight = 1 / (chosen.pdf.float().reshape(n, *pixels) + material_density(light))
    total = total + weight[..., None] * value * chosen.radiance.float().reshape(n, *pixels, 3)
    return total.mean(0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=96, help="pixels along either side")
    parser.add_argument("--samples", type=int, default=16, help="directions of either kind in a pixel")
    parser.add_argument("--environment", type=Path, help="latitude-longitude map; a sky with a sun if it is left out")
    parser.add_argument("--out", type=Path, help="picture (.png or .exr): all bounces, one bounce")
    parser.add_argument("--force", action="store_true", help="overwrite the picture")
    options = parser.parse_args()
    world = Environment(sky() if options.environment is None else read_picture(options.environment))
    g, maps = gbuffer(options.size), true_maps(options.size)
    shown = {}
    for bounces in ("all", "one"):
        material = ms.compile(ms.MetallicRoughness(*maps, bounces=bounces), verbose=False)
        with torch.no_grad():
            shown[bounces] = relit(material, g, world, options.samples, torch.Generator().manual_seed(1))
    metal = maps.metallic > 0.5
    for name, where in (("metal", metal), ("paint", ~metal)):
        for side, rough in (("smooth", maps.roughness < 0.5), ("rough", maps.roughness > 0.75)):
            all_, one = (shown[b][where & rough].mean() for b in ("all", "one"))
            print(
                f"{side} {name}: one bounce has {100 * float(one / all_ - 1):+.1f} % of the light of all bounces more"
            )
    if options.out is not None:
        write_picture(options.out, side_by_side([[shown["all"], shown["one"]]]), tone="filmic", force=options.force)


if __name__ == "__main__":
    main()
