"""python -m torchms.approximations.distil.diffuse: from a seed to a file of the lobes of diffuse facets."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import torch
from torch import Tensor

from torchms.approximations import diffuse_lobes, pair_features
from torchms.approximations.distil import scenes
from torchms.approximations.distil.command import Common, finished, run, told
from torchms.approximations.distil.rows import KINDS
from torchms.approximations.distil.squares import CHUNK, Net, Normal, Term, minimised
from torchms.bsdfs import RoughDiffuse
from torchms.bsdfs.compile import compile
from torchms.estimators import Bidirectional, Unidirectional
from torchms.maths.frame import split
from torchms.paths.segments import Invariance
from torchms.sampling.stream import Stream
from torchms.sampling.uniforms import draw, generator_for, integers

ROWS = 16384
"""Rows of a block of data."""
LONGEST = {"GGX": 12, "Beckmann": 6}
"""Most bounces of a walk; those beyond follow from the last two, whose ratio is that of all others."""
PROBE = 0.8
"""The albedo at which the fall-off of the orders from 4 on is looked at."""
POLAR, TURNS = 10, 16
"""Outgoing directions of one energy: Gauss points in cos θ, and azimuths."""
CELLS = 800


@dataclass
class Options(Common):
    """Distil the bounces of rough diffuse surfaces: data by the exact estimators, a small network, a file.

    A stopped run goes on with the blocks of data that are there if it is called again.
    """

    out: Path = Path("distilled_diffuse.npz")
    """The file."""
    blocks: int = 72
    """Blocks of 16 384 surfaces and pairs of directions."""
    paths: tuple[int, int] = (64, 2048)
    """Walks of each, and of one bounce."""
    widths: tuple[int, ...] = (20, 20)
    """Units of the hidden layers; cost and accuracy follow them."""
    steps: int = 40
    """Levenberg-Marquardt steps."""
    rows: int = 50000
    """Rows of a step."""
    energy: float = 5.0
    """Weight of the energies against that of the lobes."""
    later: ClassVar[tuple[str, ...]] = ("widths", "steps", "rows", "energy")


def block(options: Options, number: int) -> dict[str, Tensor]:
    """α_x, α_y, wi, wo and targets f (n, 5) [1/sr]: orders 1, 2, 3 and all others at albedo 1, and these at `PROBE`."""
    seed = options.seed * 4096 + number
    generator = generator_for(seed)
    ax, ay = scenes.roughnesses(options.alpha, ROWS, 0.3, generator)
    wi, wo = scenes.hemisphere(ROWS, generator), scenes.hemisphere(ROWS, generator)
    facets = KINDS[options.distribution](ax, ay)
    longest = LONGEST[options.distribution]
    with torch.no_grad():
        walks = compile(RoughDiffuse(facets, 1.0, Unidirectional(Invariance(), longest)), verbose=False)
        f = walks.orders(wi, wo, Stream(2 * seed, options.paths[0]))[..., 0]
        one = compile(RoughDiffuse(facets, 1.0, Bidirectional(Invariance(), 1)), verbose=False)
        f[:, 0] = one(wi, wo, Stream(2 * seed + 1, options.paths[1]))[:, 0]
    return {"ax": ax, "ay": ay, "wi": wi, "wo": wo, "f": f / wo[:, 2:]}


def targets(data: dict[str, Tensor]) -> Tensor:
    """π f (n, 5) with the orders that no walk had, which fall off by a factor λ(α_x, α_y) each."""
    f, ax, ay = data["f"], data["ax"].double(), data["ay"].double()
    last, before = f[:, -1].double(), f[:, -2].double()
    total, product = ax + ay, ax * ay
    basis = torch.stack([torch.ones_like(ax), total, total**2, product, product**2], 1)
    found = torch.linalg.lstsq(basis * before[:, None], last[:, None]).solution[:, 0]
    fall = (basis @ found).clamp(0.02, 0.8).float()
    beyond = f[:, -1] * fall / (1 - fall)
    k = torch.arange(f.shape[1] - 3)
    probe = (f[:, 3:] * PROBE**k).sum(1) + beyond * PROBE ** len(k) * (1 - fall) / (1 - PROBE * fall)
    return math.pi * torch.cat([f[:, :3], (f[:, 3:].sum(1) + beyond)[:, None], probe[:, None]], 1)


@torch.no_grad()
def inputs(kind: str, ax: Tensor, ay: Tensor, wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    """Features (n, FEATURES) and π times what multiplies the first output's exponential (n)."""
    distribution = KINDS[kind](ax, ay)
    i, o = pair_features.seen(distribution, split(wi)), pair_features.seen(distribution, split(wo))
    found = diffuse_lobes.features(pair_features.shape_of(distribution), i, o)
    smith = diffuse_lobes.smith(distribution, i, o)
    return torch.stack(torch.broadcast_tensors(*found), -1), smith


def lobes(outputs: Tensor, smith: Tensor) -> tuple[Tensor, Tensor]:
    """π f (n, 4) and λ (n)."""
    q = torch.exp(outputs[:, :4])
    return torch.cat([(q[:, 0] * smith)[:, None], q[:, 1:]], 1), torch.sigmoid(outputs[:, 4])


class Lobes(Term):
    """Squares of the errors of each order over the lobe, heavier where directions are steep: what its RMS sees."""

    def __init__(self, net: Net, x: Tensor, smith: Tensor, y: Tensor, cosines: Tensor, rows: int, seed: int) -> None:
        self.net, self.x, self.smith, self.y, self.cosines = net, x, smith, y, cosines
        self.rows, self.generator = min(rows, len(x)), generator_for(seed)
        self.last = False

    def redraw(self, vector: Tensor, step: int) -> None:
        self.some = integers(0, len(self.x), (self.rows,), self.generator)
        held = [lobes(self.net.outputs(vector, self.x[i]), self.smith[i])[0].sum(1) for i in self.some.split(CHUNK)]
        self.weight = self.cosines[self.some].sqrt() / (torch.cat(held) + 0.15) / math.sqrt(self.rows)

    def _errors(self, outputs: Tensor, i: Tensor, w: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        q, fall = lobes(outputs, self.smith[i])
        probe = q[:, 3] * (1 - fall) / (1 - PROBE * fall)
        slope = q[:, 3] * (PROBE - 1) / (1 - PROBE * fall) ** 2 * fall * (1 - fall)
        return w[:, None] * (torch.cat([q, probe[:, None]], 1) - self.y[i]), q, slope

    def normal(self, vector: Tensor) -> Normal:
        matrix = slope = torch.zeros((), dtype=torch.float64)
        value = 0.0
        for i, w in zip(self.some.split(CHUNK), self.weight.split(CHUNK), strict=True):
            traced = self.net.traced(vector, self.x[i])
            errors, q, by_fall = self._errors(traced.outputs, i, w)
            for k in range(5):
                factors = torch.zeros_like(traced.outputs)
                factors[:, k] = w * (q[:, k] if k < 4 else by_fall)
                rows = self.net.derivatives(vector, traced, factors, last=self.last)
                matrix, slope = matrix + (rows.T @ rows).double(), slope + (rows.T @ errors[:, k]).double()
            value += float(errors.square().sum())
        return Normal(matrix, slope, value)

    def value(self, vector: Tensor) -> float:
        return sum(
            float(self._errors(self.net.outputs(vector, self.x[i]), i, w)[0].square().sum())
            for i, w in zip(self.some.split(CHUNK), self.weight.split(CHUNK), strict=True)
        )


class Furnace(Term):
    """Squares of what the energies of all orders at albedo 1 lack."""

    def __init__(self, net: Net, x: Tensor, smith: Tensor, weights: Tensor, factor: float) -> None:
        self.net, self.x, self.smith, self.weights, self.factor = net, x, smith, weights, factor
        self.points = POLAR * TURNS
        self.last = False

    def redraw(self, vector: Tensor, step: int) -> None:
        pass

    def normal(self, vector: Tensor) -> Normal:
        matrix = slope = torch.zeros((), dtype=torch.float64)
        value, count = 0.0, len(self.x) // self.points
        for rows in torch.arange(len(self.x)).split(self.points * 32):
            traced = self.net.traced(vector, self.x[rows])
            q = lobes(traced.outputs, self.smith[rows])[0] * self.weights[rows, None]
            lacks = q.sum(1).reshape(-1, self.points).sum(1) - 1
            factors = torch.cat([q, torch.zeros_like(q[:, :1])], 1)
            found = self.net.derivatives(vector, traced, factors, last=self.last)
            found = found.reshape(-1, self.points, found.shape[1]).sum(1)
            matrix, slope = matrix + (found.T @ found).double(), slope + (found.T @ lacks).double()
            value += float(lacks.square().sum())
        scale = self.factor / count
        return Normal(matrix * scale, slope * scale, value * scale)

    def value(self, vector: Tensor) -> float:
        return self.factor * float(self.lacking(vector).square().mean())

    def lacking(self, vector: Tensor) -> Tensor:
        """Energy that is too much, of each direction of incidence."""
        q = lobes(self.net.outputs(vector, self.x), self.smith)[0].sum(1) * self.weights
        return q.reshape(-1, self.points).sum(1) - 1


def furnace_points(kind: str, alpha: tuple[float, float], seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """Features, factor of the first order and weight cos θ_o dω / π of the points of `CELLS` directions of incidence."""
    generator = generator_for(seed)
    ax, ay = scenes.roughnesses(alpha, CELLS, 0.3, generator)
    wi = scenes.hemisphere(CELLS, generator)
    turn = 2 * math.pi / TURNS * (torch.arange(TURNS) + draw((CELLS,), 1, 1, generator=generator)[:, 0])
    z, dz = scenes.gauss(POLAR)
    r = (1 - z * z).sqrt()
    cos, sin = turn.cos()[:, None], turn.sin()[:, None]
    wo = torch.stack(torch.broadcast_tensors(r[:, None] * cos, r[:, None] * sin, z[:, None]), -1).reshape(-1, 3)
    weights = ((z * dz)[:, None] * (2 / TURNS)).expand(POLAR, TURNS).flatten().repeat(CELLS)
    many = [v.repeat_interleave(POLAR * TURNS, 0) for v in (ax, ay, wi)]
    ax, ay, wi = many
    x, smith = inputs(kind, ax, ay, wi, wo)
    return x, smith, weights


def main(options: Options) -> None:
    """Run all of it."""
    data, folder = told(options, "diffuse", lambda number: block(options, number))
    x, smith = inputs(options.distribution, data["ax"], data["ay"], data["wi"], data["wo"])
    mean, spread = x.mean(0), x.std(0)
    y, cosines = targets(data), (0.15 + data["wi"][:, 2]) * (0.15 + data["wo"][:, 2])
    net = Net([diffuse_lobes.FEATURES, *options.widths, diffuse_lobes.OUTPUTS])
    start = [float(torch.log(c.mean() / (smith.mean() if k == 0 else 1))) for k, c in enumerate(y[:, :4].unbind(1))]
    vector = net.initial([*start, 0.0], generator_for(options.seed + 1))
    terms = [
        Lobes(net, (x - mean) / spread, smith, y, cosines, options.rows, options.seed + 2),
        Furnace(
            net,
            *_standard(furnace_points(options.distribution, options.alpha, options.seed + 3), mean, spread),
            options.energy,
        ),
    ]
    with finished("steps", options.steps + 4) as advance:
        for last, rows, steps in ((True, options.rows, 2), (False, options.rows, options.steps), (True, len(x), 2)):
            terms[0].rows = min(rows, len(x))
            for term in terms:
                term.last = last
            vector = minimised(terms, vector, steps, advance, only=net.linear() if last else None)
    off = terms[1].lacking(vector)
    errors = {"furnace_rms": float(off.square().mean().sqrt()), "furnace_max": float(off.abs().max())}
    options.write("diffuse", options.out, *net.folded(vector, mean, spread), len(x), sum(options.paths), errors, folder)


def _standard(points: tuple[Tensor, Tensor, Tensor], mean: Tensor, spread: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    return (points[0] - mean) / spread, points[1], points[2]


if __name__ == "__main__":
    run(main, Options)
