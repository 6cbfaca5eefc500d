"""Gradients of `Distilled` against those of the exact expectation: python benchmarks/distilled_gradients.py [--paths 2048]

For each surface and angle the derivatives of f cos θ_o by α, η, k and wi at outgoing directions of the sampler: root mean
square of the error over that of the exact ones, over the lobe. The reference is the mean of the bidirectional estimator's
gradients, which are unbiased; two halves of it, multiplied, take its noise out of the error. Copper's green.
Writes results/distilled_gradients.json.
"""

import argparse
from typing import Any

import torch
from record import save
from torch import Tensor

import torchms as ms
from torchms.approximations.metal_sampling import MetalProposal
from torchms.fresnel import Conductor
from torchms.maths.frame import Vec3, direction, join, split
from torchms.sampling.stream import Stream
from torchms.sampling.uniforms import draw

ALPHAS = ((0.1,), (0.25,), (0.5,), (1.0,), (0.5, 0.15), (1.0, 0.3))
ANGLES = (0.5, 1.0)
POINTS = 256


def leaves_of(alpha: tuple[float, ...], theta: float, n: int) -> dict[str, Tensor]:
    """Everything as a map of n pixels, so that each has a gradient of its own."""
    metal = Conductor.metal("Cu")
    found = {"alpha": torch.full((n,), alpha[0]), "alpha_y": torch.full((n,), alpha[-1])}
    found |= {"eta": metal.eta[1:2].expand(n, 1).clone(), "k": metal.k[1:2].expand(n, 1).clone()}
    found["wi"] = direction(theta, 0.4).float().expand(n, 3).clone()
    return {name: x.requires_grad_() for name, x in found.items()}


def gradients(leaves: dict[str, Tensor], wo: Tensor, scattering: ms.Scattering, u: Stream) -> dict[str, Tensor]:
    """Of the values, by each leaf."""
    distribution = ms.GGX(leaves["alpha"], leaves["alpha_y"])
    surface = ms.RoughConductor(distribution, Conductor(leaves["eta"], leaves["k"]), scattering)
    wi = torch.nn.functional.normalize(leaves["wi"], dim=-1)
    value = ms.compile(surface, verbose=False)(wi, wo, u).mean(-1)
    return dict(zip(leaves, torch.autograd.grad(value.sum(), list(leaves.values())), strict=True))


def row_of(alpha: tuple[float, ...], theta: float, paths: int) -> dict[str, Any]:
    """Errors and noise of one surface and angle."""
    leaves = leaves_of(alpha, theta, POINTS)
    proposal = MetalProposal(ms.GGX(alpha[0], alpha[-1]))
    wi = split(leaves["wi"].detach())
    wo = proposal.sample(wi, draw((POINTS,), 1, 3, generator=torch.Generator().manual_seed(1))[:, 0].unbind(-1))
    wo = Vec3(wo.x, wo.y, wo.z.clamp_min(1e-3))
    weight = 1 / proposal.density(wi, wo)
    exact = ms.Bidirectional(ms.Invariance(), 6)
    a, b = (gradients(leaves, join(wo), exact, Stream(seed, paths)) for seed in (1, 2))
    mine = gradients(leaves, join(wo), ms.Distilled(), Stream(1))
    row: dict[str, Any] = {"alpha": list(alpha), "theta": theta}
    for name, g in mine.items():
        w = weight[:, None] if g.ndim == 2 else weight
        size = (w * a[name] * b[name]).sum()
        error = (w * (g - a[name]) * (g - b[name])).sum() / size
        noise = (w * (a[name] - b[name]) ** 2).sum() / 4 / size
        row[name] = {"error": float(error.clamp_min(0).sqrt()), "noise": float(noise.clamp_min(0).sqrt())}
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--paths", type=int, default=2048)
    options = parser.parse_args()
    rows = []
    for alpha in ALPHAS:
        for theta in ANGLES:
            rows.append(row_of(alpha, theta, options.paths))
            shown = {
                k: f"{v['error']:.4f} (noise {v['noise']:.4f})" for k, v in rows[-1].items() if isinstance(v, dict)
            }
            print(alpha, theta, shown, flush=True)
    save("distilled_gradients", rows)


if __name__ == "__main__":
    main()
