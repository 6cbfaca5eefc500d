"""python -m torchms.approximations.distil.glass: from a seed to the two files of the lobes of rough glass.

Light comes from above, from a medium of index 1; η is that of the other one, above or below 1. What is reflected and what
is transmitted have a network each, and are fitted by themselves.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from torchms.approximations import glass_lobes, pair_features
from torchms.approximations.coordinates import ETA
from torchms.approximations.distil import scenes
from torchms.approximations.distil.balanced import balanced_orders
from torchms.approximations.distil.command import Common, finished, run, told
from torchms.approximations.distil.rows import KINDS
from torchms.approximations.distil.squares import CHUNK, Net, Normal, Term, minimised
from torchms.bsdfs import RoughDielectric
from torchms.estimators import HeightWalk, SingleBounce
from torchms.fresnel import Dielectric
from torchms.maths.frame import split
from torchms.sampling.stream import Stream
from torchms.sampling.uniforms import draw, generator_for, integers

ROWS = 16384
"""Rows of a block of data."""
LONGEST = 10
"""Most bounces of a walk."""
LEAST_LOG = 0.02
"""Smallest |ln η|."""
EXPONENT = (-30.0, 12.0)
HELD = 20
"""One row of so many is held out."""


@dataclass
class Options(Common):
    """Distil what rough glass does after its first bounce: data by height walks, two small networks, two files.

    A stopped run goes on with the blocks of data that are there if it is called again.
    """

    outs: tuple[Path, Path] = (Path("distilled_reflected.npz"), Path("distilled_transmitted.npz"))
    """The files."""
    paths: int = 64
    """Walks of each row."""
    widths: tuple[int, ...] = (24, 20)
    """Units of the hidden layers; cost and accuracy follow them."""
    steps: int = 60
    """Levenberg-Marquardt steps of each network."""
    rows: int = 100000
    """Rows of a step."""


@torch.no_grad()
def block(options: Options, number: int) -> dict[str, Tensor]:
    """Surfaces, wi above, wo on either side, half of them where a walk left, f · |cos θ_o| [1/sr] of one bounce and of
    the rest, and the energies of one bounce on either side."""
    seed = options.seed * 4096 + number
    generator = generator_for(seed)
    ax, ay = scenes.roughnesses(options.alpha, ROWS, 0.4, generator)
    eta = scenes.indices(ROWS, LEAST_LOG, ETA, generator)
    wi, wo = scenes.hemisphere(ROWS, generator), scenes.hemisphere(ROWS, generator)
    u = draw((ROWS,), 1, 2, generator=generator)[:, 0]
    wo = torch.where(u[:, :1] < 0.5, -wo, wo)
    facets, index = KINDS[options.distribution](ax, ay), Dielectric(eta)
    plain = RoughDielectric(facets, index, HeightWalk(LONGEST), "importance")
    left = plain.sample_walk(wi, Stream(4 * seed, 1))
    steep = left.wo[:, 0, 2].abs() > scenes.LEAST_COSINE
    wo = torch.where(((left.order[:, 0] > 0) & steep & (u[:, 1] < 0.55))[:, None], left.wo[:, 0], wo)
    values = balanced_orders(facets, eta, wi, wo, 4 * seed + 1, options.paths, LONGEST)
    one = RoughDielectric(facets, index, SingleBounce(), "importance").albedo(wi, Stream(4 * seed + 2, 32, "sobol"))
    energies = torch.stack([one.reflected[:, 0, 0], one.transmitted[:, 0, 0]], 1)
    f = torch.stack([values[:, 0], values[:, 1:].sum(1)], 1)
    return {"ax": ax, "ay": ay, "eta": eta, "wi": wi, "wo": wo, "f": f, "energies": energies}


@torch.no_grad()
def inputs(kind: str, data: dict[str, Tensor], up: bool) -> tuple[Tensor, Tensor]:
    """Rows (n) with wo above, or below, and their features."""
    some = ((data["wo"][:, 2] > 0) == up).nonzero()[:, 0]
    distribution = KINDS[kind](data["ax"][some], data["ay"][some])
    shape, eta = pair_features.shape_of(distribution), data["eta"][some]
    i = pair_features.seen(distribution, split(data["wi"][some]))
    o = pair_features.seen(distribution, split(data["wo"][some] * (1.0 if up else -1.0)))
    if up:
        found = glass_lobes.reflected_features(shape, torch.log(eta), i, o)
    else:
        into = eta > 1
        thin, dense = glass_lobes.chosen(into, i, o), glass_lobes.chosen(into, o, i)
        found = glass_lobes.transmitted_features(shape, torch.log(eta).abs(), thin, dense)
    return some, torch.stack(torch.broadcast_tensors(*found), -1)


class Rest(Term):
    """Squares of the errors over the whole lobe at the place, or over its root mean square on that side."""

    def __init__(
        self, net: Net, data: dict[str, Tensor], some: Tensor, x: Tensor, up: bool, rows: int, seed: int
    ) -> None:
        self.net, self.x, self.rows, self.generator = net, x, rows, generator_for(seed)
        eta, root = data["eta"][some], torch.sqrt(data["ax"] * data["ay"])[some]
        log = torch.log(eta).abs()
        reflected, transmitted = data["energies"][some].unbind(1)
        self.single, self.y = data["f"][some].unbind(1)
        self.scale = data["wo"][some, 2].abs() / math.pi * (1.0 if up else eta)
        if up:
            self.size = (1.3 * reflected + 1e-5) * (0.1 + 0.1 / root)
            # Walks that skim through a denser medium of nearly the same index are rare and heavy.
            near = torch.where(eta < 1, log / 0.4, log / 0.12)
        else:
            lost = (1 - reflected - transmitted).clamp_min(0)
            energy = 1.1 * transmitted + 0.1 * lost + 1e-3
            self.size = energy * (0.1 + 0.1 / (root * log.clamp_min(0.05)))
            near = log / 0.12
        self.near2 = near.clamp_max(1) ** 2
        kept = len(x) - len(x) // HELD
        self.train, self.held = torch.arange(kept), torch.arange(kept, len(x))

    def lobe(self, outputs: Tensor, i: Tensor) -> Tensor:
        """f · |cos θ_o| [1/sr]."""
        return torch.exp(outputs[:, 0].clamp(*EXPONENT)) * self.scale[i]

    def judged(self, q: Tensor, i: Tensor) -> tuple[Tensor, Tensor]:
        """Weights, and targets without the few that are far beyond everything."""
        around = self.single[i] + q
        weight = self.near2[i] / (around**2 + (0.3 * self.size[i]) ** 2)
        return weight, torch.minimum(self.y[i], 20 * (around + self.size[i]))

    def redraw(self, vector: Tensor, step: int) -> None:
        if step % 3 == 0:
            self.some = self.train[integers(0, len(self.train), (min(self.rows, len(self.train)),), self.generator)]
        parts = [self.judged(self.lobe(self.net.outputs(vector, self.x[i]), i), i) for i in self.some.split(CHUNK)]
        self.fixed = [(w / len(self.some), y) for w, y in parts]

    def normal(self, vector: Tensor) -> Normal:
        matrix = slope = torch.zeros((), dtype=torch.float64)
        value = 0.0
        for i, (w, y) in zip(self.some.split(CHUNK), self.fixed, strict=True):
            traced = self.net.traced(vector, self.x[i])
            q, root = self.lobe(traced.outputs, i), w.sqrt()
            rows, errors = self.net.derivatives(vector, traced, (root * q)[:, None]), root * (q - y)
            matrix, slope = matrix + (rows.T @ rows).double(), slope + (rows.T @ errors).double()
            value += float(errors.square().sum())
        return Normal(matrix, slope, value)

    def value(self, vector: Tensor) -> float:
        return sum(
            float((w * (self.lobe(self.net.outputs(vector, self.x[i]), i) - y) ** 2).sum())
            for i, (w, y) in zip(self.some.split(CHUNK), self.fixed, strict=True)
        )

    def held_out(self, vector: Tensor) -> float:
        """Mean weighted square of the rows that no step saw; their noise is in it."""
        q = self.lobe(self.net.outputs(vector, self.x[self.held]), self.held)
        weight, y = self.judged(q, self.held)
        return float((weight * (q - y) ** 2).mean())


def main(options: Options) -> None:
    """Run all of it."""
    data, folder = told(options, "glass", lambda number: block(options, number))
    for up, out in zip((True, False), options.outs, strict=True):
        some, x = inputs(options.distribution, data, up)
        mean, spread = x.mean(0), x.std(0)
        net = Net([x.shape[1], *options.widths, 1])
        rest = Rest(net, data, some, (x - mean) / spread, up, options.rows, options.seed + 2)
        start = float(torch.log((rest.y / rest.scale).clamp_max(3).median().clamp_min(1e-4))) - 0.5
        vector = net.initial([start], generator_for(options.seed + 1))
        facet = "reflected" if up else "transmitted"
        with finished(facet, options.steps) as advance:
            vector = minimised([rest], vector, options.steps, advance)
        errors = {"weighted_square": rest.held_out(vector)}
        options.write(facet, out, *net.folded(vector, mean, spread), len(some), errors, folder)


if __name__ == "__main__":
    run(main, Options)
