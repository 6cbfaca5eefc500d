"""A material as a network
=======================

A material as a network of the texture coordinates, learned from what random cameras saw under random lights.

::

    python examples/learned_material.py --out learned.png --onnx shader.onnx

The network gives base colour, metallic and roughness; torchms turns them into radiance and hands the gradients back. What is
written as ONNX takes these numbers as inputs, so that network and shader run wherever ONNX does.
"""

import argparse
import math
from pathlib import Path

import torch
from gbuffer import Maps, side_by_side, true_maps
from torch import Tensor, nn
from torch.nn.functional import normalize

import torchms as ms
from torchms.render.images import write_picture


class Material(nn.Module):
    """Base colour, metallic and roughness at texture coordinates (n, 2) in [0, 1]."""

    def __init__(self, octaves: int = 5, width: int = 48) -> None:
        super().__init__()
        self.octaves = octaves
        self.layers = nn.Sequential(
            nn.Linear(4 * octaves, width), nn.SiLU(), nn.Linear(width, width), nn.SiLU(), nn.Linear(width, 5)
        )

    def forward(self, uv: Tensor) -> Maps:
        waves = torch.cat([math.pi * 2**k * uv for k in range(self.octaves)], -1)
        inside = torch.sigmoid(self.layers(torch.cat([waves.sin(), waves.cos()], -1)))
        return Maps(inside[:, :3], inside[:, 3], 0.1 + 0.9 * inside[:, 4])


def upwards(n: int, generator: torch.Generator) -> Tensor:
    """(n, 3) directions of the upper hemisphere in the surface's frame, few at its rim."""
    w = torch.randn(n, 3, generator=generator)
    return normalize(torch.cat([w[:, :2], w[:, 2:].abs() + 0.3], 1), dim=-1)


def seen(maps: Maps, view: Tensor, light: Tensor) -> Tensor:
    """f · cos (n, 3). One program serves every step: only what the network gave is new."""
    return ms.compile(ms.MetallicRoughness(*maps), verbose=False)(view, light)


def picked(maps: Maps, n: int, generator: torch.Generator) -> tuple[Tensor, Maps]:
    """Texture coordinates (n, 2) of random texels, and what is there."""
    rows, columns = maps.metallic.shape
    i, j = (torch.randint(k, (n,), generator=generator) for k in (rows, columns))
    uv = torch.stack([(j + 0.5) / columns, (i + 0.5) / rows], -1)
    return uv, Maps(*(x[i, j] for x in maps))


def learned(truth: Maps, steps: int, batch: int, generator: torch.Generator) -> Material:
    """A network that looks like `truth`."""
    network = Material()
    adam = torch.optim.Adam(network.parameters(), lr=5e-3)
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(adam, steps, eta_min=1e-4)
    for _ in range(steps):
        uv, there = picked(truth, batch, generator)
        view, light = upwards(batch, generator), upwards(batch, generator)
        with torch.no_grad():
            target = seen(there, view, light)
        error = (seen(network(uv), view, light) - target) / (target + 0.05)
        adam.zero_grad()
        (error * error).mean().backward()
        adam.step()
        decay.step()
    return network


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=64, help="texels along either side of the material to be learned")
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--batch", type=int, default=2048)
    parser.add_argument("--out", type=Path, help="picture (.png) of the maps: truth, learned")
    parser.add_argument("--onnx", type=Path, help="ONNX file of the shader, the maps are inputs")
    parser.add_argument("--force", action="store_true", help="overwrite the files")
    options = parser.parse_args()
    torch.manual_seed(0)
    generator = torch.Generator().manual_seed(1)
    truth = true_maps(options.size)
    network = learned(truth, options.steps, options.batch, generator)
    t = (torch.arange(options.size) + 0.5) / options.size
    u, v = t.expand(options.size, options.size), t[:, None].expand(options.size, options.size)
    with torch.no_grad():
        maps = Maps(
            *(
                x.reshape(options.size, options.size, *x.shape[1:])
                for x in network(torch.stack([u, v], -1).reshape(-1, 2))
            )
        )
        uv, there = picked(truth, 4096, generator)
        view, light = upwards(4096, generator), upwards(4096, generator)
        target = seen(there, view, light)
        error = ((seen(network(uv), view, light) - target).abs() / (target + 0.05)).mean()
    print(f"new views and lights: mean relative error {100 * float(error):.1f} %")
    for name, a, b in zip(Maps._fields, maps, truth, strict=True):
        print(f"{name}: mean error {float((a - b).abs().mean()):.3f}")
    if options.out is not None:
        write_picture(options.out, side_by_side([list(truth), list(maps)]), force=options.force)
    if options.onnx is not None:
        shader = ms.MetallicRoughness([0.5, 0.5, 0.5], 0.5, 0.5)
        ms.onnx.export(shader, options.onnx, parameters=("base_color", "metallic", "roughness"), force=options.force)


if __name__ == "__main__":
    main()
