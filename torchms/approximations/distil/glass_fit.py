"""The networks of what glass reflects, or transmits, and their fit to whole lobes and to the energy that is left for them."""

from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor

from torchms.approximations import distilled_file as files
from torchms.approximations import glass_features, glass_lobes, pair_features
from torchms.approximations.distil import glass_rows, glass_targets, refinement, whole
from torchms.approximations.distil.activations import ROOT
from torchms.approximations.distil.energies import Cells
from torchms.approximations.distil.glass_rows import Surfaces
from torchms.approximations.distil.level import Level
from torchms.approximations.distil.rows import OUTGOING
from torchms.approximations.distil.weights import Inputs, Weights
from torchms.maths.frame import split
from torchms.sampling.uniforms import generator_for

POINTS = 512
"""Outgoing directions of an energy on either side."""
FIRST, WHOLE = 0.3, 0.1
"""Shares of one bounce's value, and of the lobe's root mean square, that a row's error is measured by, if they are more."""


@torch.no_grad()
def inputs_of(
    kind: str,
    where: Surfaces,
    wo: Tensor,
    up: bool,
    step: int = 16384,
    features: glass_features.Features = glass_features.SYMMETRIC,
) -> tuple[Inputs, Tensor]:
    """The features of rows, and what exp(level) is multiplied by for f |cos θ_o| [1/sr] (n)."""
    parts: list[list[Tensor]] = [[], [], []]
    for some in torch.arange(len(wo)).split(step):
        here = where.part(some)
        distribution, log_eta = here.distribution(kind), torch.log(here.eta)
        shape = pair_features.shape_of(distribution)
        i = pair_features.seen(distribution, split(here.wi))
        o = pair_features.seen(distribution, split(wo[some] * (1.0 if up else -1.0)))
        if up:
            pairs = features.reflected(shape, log_eta, i, o)
        else:
            into = here.eta > 1
            thin, dense = glass_features.chosen(into, i, o), glass_features.chosen(into, o, i)
            pairs = features.transmitted(shape, log_eta.abs(), thin, dense)
        of_one = (features.of_one(shape, eta, w) for eta, w in ((log_eta, i), (log_eta if up else -log_eta, o)))
        for column, found in zip(parts, (pairs, *of_one), strict=True):
            column.append(torch.stack(torch.broadcast_tensors(*found), -1))
    return Inputs(*(torch.cat(column) for column in parts)), glass_lobes.scale(wo[:, 2].abs(), where.eta, not up)


class Fit:
    """What leaves on one side: its data and the state of its networks."""

    def __init__(
        self,
        kind: str,
        where: Surfaces,
        wo: Tensor,
        weights: Tensor,
        f: Tensor,
        widths: tuple[Sequence[int], Sequence[int]],
        seed: int,
        begin: files.Distillate | None = None,
    ) -> None:
        self.kind, self.up, self.seed = kind, bool(wo[0, 2] > 0), seed + 7
        inputs, scale = inputs_of(kind, where.repeated(OUTGOING), wo, self.up)
        first, rest = (f / scale[:, None]).unbind(1)
        lobe = weights * OUTGOING * scale * scale
        squares = (first + rest).square()
        size = (lobe * squares).view(-1, OUTGOING).sum(1) / lobe.view(-1, OUTGOING).sum(1).clamp_min(1e-20)
        floor = torch.hypot(FIRST * first, WHOLE * size.sqrt().repeat_interleave(OUTGOING))
        start = float(torch.log(rest.clamp_min(1e-6)).median())
        self.weights = Weights(*widths, inputs, 1, glass_lobes.EXPONENT, start, ROOT)
        self.level = Level(self.weights)
        share = refinement.shares(lobe, first + rest)
        self.data = refinement.Data(self.weights.standardised(inputs), rest, floor, share)
        self.vector = self.weights.initial(generator_for(self.seed))
        if begin is not None:
            self.weights.begin_with(self.vector, begin)
        self.cells: Cells | None = None

    def energies(self) -> Tensor:
        """What leaves on this side after more than one bounce, of each cell."""
        assert self.cells is not None
        return refinement.energies(self.level, self.vector, self.cells)

    def refined(
        self, other: "Fit | None", steps: int, rows: int, checkpoint: Path, advance: Callable[[int], None]
    ) -> None:
        """`steps` on the lobes, and on the energy that one bounce and the `other` side leave; None: on lobes only."""
        cells = self.cells
        assert cells is not None
        cells = cells.part(0, 0) if other is None else cells._replace(lost=cells.lost - other.energies())
        self.vector = whole.refined(
            self.weights, self.vector, self.data, cells, steps, self.seed, checkpoint, advance, rows
        )

    def distillate(self, facet: str, alpha: tuple[float, float]) -> files.Distillate:
        """Its networks as a file holds them."""
        pair, each = self.weights.folded(self.vector)
        return files.Distillate(facet, self.kind, alpha, *pair, {}, each)


@torch.no_grad()
def balanced(sides: Sequence[Fit], kind: str, where: Surfaces, seed: int) -> None:
    """Give both sides the same directions of incidence, for the energies."""
    lost = 1 - glass_targets.first_energy(kind, where, seed)
    for fit in sides:
        lobes = glass_rows.lobes(kind, where, fit.up, POINTS, generator_for(seed + 1 + fit.up))
        inputs, scale = inputs_of(kind, where.repeated(POINTS), lobes.wo.reshape(-1, 3), fit.up)
        fit.cells = Cells(fit.weights.standardised(inputs), lobes.weights.reshape(-1) * scale, lost)
