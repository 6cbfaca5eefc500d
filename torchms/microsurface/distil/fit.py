"""From simulated light to the weights of a correction: the likelihood of the paths, then facet cosines and the tail."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.distil.rows import LEAST_COSINE, Rows
from torchms.approximations.distil.weights import Inputs
from torchms.approximations.metal_lobes import fall_of
from torchms.approximations.network import Layer, soft_sign
from torchms.approximations.surface_correction import ORDERS
from torchms.cli.progress import progress_bar
from torchms.distributions import Beckmann
from torchms.maths.frame import Vec3, join, split
from torchms.microsurface.distil import likelihood
from torchms.microsurface.distil.kinds import Kind
from torchms.microsurface.distil.light import RAYS, Light
from torchms.microsurface.distil.networks import Correction, Folded
from torchms.sampling.proposals import Proposal
from torchms.sampling.uniforms import draw, generator_for

OTHERS = 1 << 18
"""Paths that the other outputs are fitted to."""
OTHER_STEPS = 60
TAIL = 0.003
CHUNK = 8192
POINTS = 64
"""Directions out for each direction in, over which integrals are summed."""


class Subject(NamedTuple):
    """What is corrected. inputs: features of rows; smith: its f cos θ_o [1/sr] (n, ORDERS) there; of that kind."""

    inputs: Callable[[Rows], Inputs]
    smith: Callable[[Rows], Tensor]
    kind: Kind


def learned(
    subject: Subject,
    light: Light,
    sizes: tuple[Sequence[int], Sequence[int]],
    steps: int,
    seed: int,
    folder: Path,
) -> tuple[Folded, Folded]:
    """Networks of the pair and of each direction, for features as they are."""
    inputs = subject.inputs(light.rows)
    rows, inverse = answers(light.where, subject.kind.proposal, seed + 5)
    points = subject.inputs(rows), subject.smith(rows) * (inverse[:, None] / POINTS)
    model, vector, seen = correction(inputs, light, points, sizes, steps, seed, folder)
    with progress_bar("other outputs", OTHER_STEPS) as advance:
        others = other_outputs(model, vector, seen, light, subject.kind.cosines, advance)
    pair, each = model.folded(vector)
    return joined(pair, model, others), each


def correction(
    inputs: Inputs,
    light: Light,
    points: tuple[Inputs, Tensor],
    sizes: tuple[Sequence[int], Sequence[int]],
    steps: int,
    seed: int,
    folder: Path,
    name: str = "likelihood",
) -> tuple[Correction, Tensor, Inputs]:
    """The networks that make `light` most likely, their numbers, and the standardised features of the paths.

    inputs: features of the paths. points: features where integrals are summed, POINTS a direction, and Smith's λ_k times the
    shares of each (n, ORDERS). name: of the checkpoint.
    """
    model, m = Correction(*sizes, inputs), len(light.where.ax)
    index, seen = light.order.clamp_max(ORDERS) - 1, model.standardised(inputs)
    paths = likelihood.Paths(seen, index, light.weight / RAYS, light.first)
    there = likelihood.Points(model.standardised(points[0]), points[1], POINTS)
    vector = model.initial(generator_for(seed + 1))
    kept = folder / f"{name}-{'-'.join('x'.join(map(str, widths)) for widths in sizes)}-{m}-{steps}.npz"
    with progress_bar(name, steps) as advance:
        vector = likelihood.fitted(model, vector, paths, there, steps, kept, advance)
    return model, vector, seen


def answers(where: Rows, proposed: Callable[[Beckmann], Proposal], seed: int) -> tuple[Rows, Tensor]:
    """POINTS directions out for each of these directions in, near where Smith's theory sends light, and 1 / their density.

    Integrals are summed there, for the very directions that light came from: nothing is learned from how many there were.
    """
    found: list[list[Tensor]] = [[], []]
    u = draw(where.ax.shape, POINTS, 3, generator=generator_for(seed), sequence="sobol")
    for some in torch.arange(len(where.ax)).split(CHUNK // POINTS):
        proposal = proposed(Beckmann(where.ax[some, None], where.ay[some, None]))
        wi = split(where.wi[some, None])
        wo = proposal.sample(wi, u[some].unbind(-1))
        wo = Vec3(wo.x, wo.y, wo.z.clamp_min(LEAST_COSINE))
        found[0].append(join(wo).flatten(0, 1))
        found[1].append((1 / proposal.density(wi, wo)).flatten())
    wo, inverse = (torch.cat(column) for column in found)
    ax, ay, wi = (x.repeat_interleave(POINTS, 0) for x in (where.ax, where.ay, where.wi))
    return Rows(ax, ay, wi, wo), inverse


def other_outputs(
    model: Correction, vector: Tensor, inputs: Inputs, light: Light, cosines: int, advance: Callable[[int], None]
) -> tuple[Tensor, Tensor, Tensor]:
    """Last layer, offsets and linear part of the cosines (3, or none) and the fall, by least squares.

    Of paths of k ≥ 2 bounces: (1 − c)⁵ is the mean of Σ (1 − c_l)⁵ / k, and 4 + r / (1 − r) that of k from four on.
    """
    some = torch.nonzero(light.order > 1)[:OTHERS, 0]
    order, steep = light.order[some], light.steep[some]
    pair, _ = model.parts(vector)
    with torch.no_grad():
        x = inputs.pair[some]
        known = torch.cat([model.pair.traced(pair, x).seen[-1], x], 1)
    numbers = torch.zeros(cosines + 1, known.shape[1] + 1, requires_grad=True)
    optimizer = torch.optim.LBFGS([numbers], max_iter=OTHER_STEPS, history_size=20, line_search_fn="strong_wolfe")
    which = order.clamp_max(ORDERS) - 2
    last = order >= ORDERS

    def loss() -> Tensor:
        optimizer.zero_grad(set_to_none=True)
        found = torch.addmm(numbers[:, -1], known, numbers[:, :-1].T)
        fall = fall_of(found[last, -1])
        value = TAIL * ((4 + fall / (1 - fall) - order[last]) ** 2).sum() / len(order)
        if cosines:
            cosine = 0.5 + 0.5 * soft_sign(found.gather(1, which[:, None])[:, 0])
            value = value + (((1 - cosine) ** 5 - steep / order) ** 2).mean()
        value.backward()
        return value

    optimizer.step(loss)
    advance(OTHER_STEPS)
    weight, linear, offset = numbers.detach().split([known.shape[1] - x.shape[1], x.shape[1], 1], 1)
    return weight, offset[:, 0], linear


def joined(pair: Folded, model: Correction, others: tuple[Tensor, Tensor, Tensor]) -> Folded:
    """The pair's network with the other outputs behind its corrections."""
    weight, offset, linear = others
    layers, skip = pair
    linear = linear / model.spread
    last: Layer = (torch.cat([layers[-1][0], weight]), torch.cat([layers[-1][1], offset - linear @ model.mean]))
    return [*layers[:-1], last], torch.cat([skip, linear])
