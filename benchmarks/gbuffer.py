"""A training step over a G-buffer, compiled: all bounces against one. `python benchmarks/gbuffer.py`

512 × 512 pixels, 4 lights, base colour, metallic and roughness per pixel; a step is world-space shading, forward and
backward to all three maps. A ratio means something only where nothing else computes. The goal is at most 3.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from record import RESULTS, save, seconds
from torch import Tensor
from torch.nn.functional import normalize

import torchms as ms
from torchms.shading import shade


def upper(shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    """Directions of the upper hemisphere of the world."""
    w = torch.randn(*shape, 3, generator=generator)
    return normalize(torch.cat([w[..., :2], w[..., 2:].abs() + 0.3], -1), dim=-1)


def step(size: int, lights: int, words: dict[str, Any]) -> Callable[[bool], None]:
    """One step; without gradients if it is told so."""
    generator = torch.Generator().manual_seed(0)
    base = torch.rand(size, size, 3, generator=generator, requires_grad=True)
    metallic, roughness = (torch.rand(size, size, generator=generator).requires_grad_() for _ in range(2))
    normal, view = upper((size, size), generator), upper((size, size), generator)
    light = upper((lights, 1, 1), generator)

    def run(backward: bool) -> None:
        with torch.set_grad_enabled(backward):
            material = ms.compile(ms.MetallicRoughness(base, metallic, roughness, **words), verbose=False)
            value = shade(material, normal, view, light)
            if backward:
                torch.autograd.grad(value.sum(), (base, metallic, roughness))

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--lights", type=int, default=4)
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument("--out", type=Path, default=RESULTS / "gbuffer.json")
    options = parser.parse_args()
    rows = []
    print(f"{options.size}² pixels, {options.lights} lights, {torch.get_num_threads()} threads; median seconds")
    for name, words in (
        ("lambert", {}),
        ("rough", {"diffuse": "rough"}),
        ("anisotropic", {"anisotropy": torch.tensor(0.5)}),
    ):
        one, all_ = (step(options.size, options.lights, {**words, "bounces": b}) for b in ("one", "all"))
        for what, backward in (("values", False), ("training step", True)):
            times = {
                b: seconds(lambda s=s, g=backward: s(g), options.repetitions) for b, s in (("one", one), ("all", all_))
            }
            ratio = times["all"]["median"] / times["one"]["median"]
            rows.append(
                {
                    "base": name,
                    "what": what,
                    "size": options.size,
                    "lights": options.lights,
                    "seconds": times,
                    "ratio": ratio,
                }
            )
            one_s, all_s = (times[b]["median"] for b in ("one", "all"))
            print(f"{name:12} {what:14} one {one_s:7.3f}   all {all_s:7.3f}   ratio {ratio:5.2f}")
    save("gbuffer", rows, options.out)


if __name__ == "__main__":
    main()
