"""What a rough dielectric does after its first bounce, as smooth functions of both directions: no random numbers.

Seen from its own side, which has an index of 1, and with η that of the other side, a surface reflects exp(n_r) / π, a
number that does not change when both directions are exchanged. What it transmits is η exp(n_t) / π, where n_t knows the
direction in the thinner medium, that in the denser one, and the ratio of the indices above 1 only: so
f(i → o) / n_o² = f(o → i) / n_i² holds exactly. Each has two networks of its own: one of the pair, and one of either
direction, whose outputs are added and carry the energy that the direction asks for.
"""

import math
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor, nn

from torchms.approximations import pair_features as pair
from torchms.approximations.distilled_file import Distillate
from torchms.approximations.glass_sampling import GlassRest
from torchms.approximations.network import Network
from torchms.distributions.base import EllipticDistribution
from torchms.estimators.base import Exit
from torchms.estimators.single_bounce import SingleBounce
from torchms.maths.frame import Vec3, select
from torchms.paths.refractive import Refractive

REFLECTED, TRANSMITTED = 21, 22
"""Inputs of the networks of pairs."""
OF_ONE = 12
"""Inputs of those of one direction."""
EXPONENT = (-30.0, 12.0)
"""Range of ln f: no network that was trained leaves it, and none overflows."""
NEAR = 0.005
"""What keeps ln(η − 1) finite."""
STEP = 0.2
"""Width of the step at total reflection."""


def reflected_features(shape: pair.Shape, log_eta: Tensor, i: pair.Seen, o: pair.Seen) -> list[Tensor]:
    """Inputs for two directions on one side, symmetric in them; η = n of the other side / n of this one."""
    along, across, stretched = pair.facing(shape, i, o)
    form, height, _ = pair.half_vector_features(shape, Vec3(i.w.x + o.w.x, i.w.y + o.w.y, i.w.z + o.w.z))
    cos2 = (1 + along + i.w.z * o.w.z) * 0.5
    excess = torch.exp(2 * log_eta) - 1
    # The square root of Fresnel's reflectance at normal incidence.
    amplitude = torch.tanh(log_eta / 2)
    return [
        *pair.shared(shape, i, o, along, across, stretched),
        form,
        height,
        torch.sqrt(cos2 + 1e-4),
        log_eta,
        torch.log(amplitude * amplitude + 1e-3),
        pair.root_sign(excess + cos2, STEP),
        pair.root_sign(excess + i.w.z * i.w.z, STEP) + pair.root_sign(excess + o.w.z * o.w.z, STEP),
        torch.log(cos2 / (amplitude * amplitude + 1e-4) + 0.1),
    ]


def transmitted_features(shape: pair.Shape, log_eta: Tensor, thin: pair.Seen, dense: pair.Seen) -> list[Tensor]:
    """Inputs for a direction in the thinner and one in the denser medium, each in the frame of its side; ln η > 0."""
    along, across, stretched = pair.facing(shape, thin, dense)
    n = torch.exp(log_eta)
    gap = torch.log(n - 1 + NEAR)
    a, b = thin.w, dense.w
    p = Vec3(n * b.x - a.x, n * b.y - a.y, n * b.z - a.z)
    form, height, length2 = pair.half_vector_features(shape, p)
    return [
        a.z,
        b.z,
        thin.masking,
        dense.masking,
        thin.height,
        dense.height,
        along,
        stretched,
        shape.log,
        shape.sum,
        shape.q * shape.q,
        pair.slanted(shape, a),
        pair.slanted(shape, b),
        across,
        pair.slanted(shape, p) / length2,
        form,
        height,
        torch.log(length2) - 2 * gap,
        log_eta,
        gap,
        torch.sqrt((1 + along + a.z * b.z) * 0.5 + 1e-4),
        pair.root_sign(1 - n * n * (1 - b.z * b.z), STEP),
    ]


def features_of_one(shape: pair.Shape, log_eta: Tensor, w: pair.Seen) -> list[Tensor]:
    """Inputs for one direction in the frame of its side; η = n of the other side / n of this one."""
    amplitude = torch.tanh(log_eta / 2)
    sx, sy = shape.ax * w.w.x, shape.ay * w.w.y
    return [
        w.height,
        w.w.z,
        torch.log(w.height + 1e-2),
        shape.log,
        shape.sum,
        shape.q * shape.q,
        pair.slanted(shape, w.w),
        shape.q * (sx * sx - sy * sy) / (w.length * w.length),
        log_eta,
        torch.log(amplitude * amplitude + 1e-3),
        pair.root_sign(torch.exp(2 * log_eta) - 1 + w.w.z * w.w.z, STEP),
        torch.sqrt(1 - w.height * w.height + 1e-4),
    ]


class Side(nn.Module):
    """ln f of what is reflected, or of what is transmitted."""

    def __init__(self, distillate: Distillate) -> None:
        super().__init__()
        assert distillate.each is not None
        self.network = Network(distillate.layers, distillate.skip, pair.root_sign)
        self.each = Network(*distillate.each, pair.root_sign)

    def forward(self, pairs: Sequence[Tensor], of_both: Sequence[Tensor]) -> Tensor:
        """From features of the pairs (…), and of both directions (2, …)."""
        (level,), (both,) = self.network(pairs), self.each(of_both)
        return level + (both[0] + both[1])


class GlassLobes(nn.Module):
    """The rest of rough glass of one kind of distribution."""

    n_extra = GlassRest.n_uniforms

    def __init__(self, reflected: Distillate, transmitted: Distillate) -> None:
        super().__init__()
        self.reflected, self.transmitted = Side(reflected), Side(transmitted)
        self.single = SingleBounce()

    def evaluate(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> list[Tensor]:
        """f · |cos θ_o| [1/sr] of one bounce and of all others together, each (1, 1, …); no order has its own beyond."""
        rest = self.rest(vertex, wi, wo)[None]
        return [*self.single.evaluate(vertex, wi, wo, ()), rest, torch.zeros_like(rest), torch.zeros_like(rest)]

    def walk(self, vertex: Refractive, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        """One bounce, and a direction in which the rest leaves, chosen beforehand about as often as it does."""
        _, side, served = vertex.enter(wi)
        proposal = GlassRest(vertex)
        again = proposal.share(wi)
        (first,) = self.single.walk(vertex, wi, u)
        escapes = (1 - again).expand_as(first.escapes)
        yield Exit(first.d, first.weight * (first.escapes / (1 - again)), escapes, first.transmitted)
        d = proposal.sample(wi, u[1 + vertex.n_uniforms :])
        density = proposal.density(wi, d)
        can_leave = served & (density > 0)
        value = self.rest(vertex, wi, d) / (torch.where(can_leave, density, 1.0) * again)
        weight = torch.where(can_leave, value, 0.0)[None]
        escapes = again.expand_as(first.escapes)
        transmitted = (d.z > 0) != (side > 0)
        yield Exit(d, weight, escapes, transmitted)
        for _ in range(2):
            yield Exit(d, torch.zeros_like(weight), torch.zeros_like(escapes), transmitted)

    def rest(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> Tensor:
        """f · |cos θ_o| [1/sr] of all bounces after the first one, without the η² of radiance."""
        distribution = vertex.distribution
        assert isinstance(distribution, EllipticDistribution)
        w, side, _ = vertex.enter(wi)
        d, there, _ = vertex.enter(wo)
        assert side is not None and there is not None
        eta = vertex.fresnel.relative_eta(side)
        log_eta = torch.log(eta)
        shape = pair.shape_of(distribution)
        i, o = pair.seen(distribution, pair.above(w)), pair.seen(distribution, pair.above(d))
        into_denser = eta > 1
        thin, dense = chosen(into_denser, i, o), chosen(into_denser, o, i)
        crosses = side != there
        # Seen from its own side, wo meets the inverse index if that is the other one.
        log_etas = torch.stack(torch.broadcast_tensors(log_eta, torch.where(crosses, -log_eta, log_eta)))
        of_both = features_of_one(shape, log_etas, stacked(i, o))
        n_r = self.reflected(reflected_features(shape, log_eta, i, o), of_both)
        n_t = self.transmitted(transmitted_features(shape, log_eta.abs(), thin, dense), of_both)
        value = torch.exp(torch.where(crosses, n_t, n_r).clamp(*EXPONENT)) * scale(d.z, eta, crosses)
        return torch.where((wi.z != 0) & (wo.z != 0), value, 0.0)


def scale(cos: Tensor, eta: Tensor, crosses: Tensor | bool) -> Tensor:
    """What exp(n) is multiplied by for f · cos θ_o [1/sr]."""
    factor = cos / math.pi
    if isinstance(crosses, bool):
        return factor * eta if crosses else factor
    return torch.where(crosses, eta, 1.0) * factor


def stacked(a: pair.Seen, b: pair.Seen) -> pair.Seen:
    """Both, along a first axis."""

    def both(x: Tensor, y: Tensor) -> Tensor:
        return torch.stack(torch.broadcast_tensors(x, y))

    rest = (both(x, y) for x, y in zip(a[1:], b[1:], strict=True))
    return pair.Seen(Vec3(*(both(x, y) for x, y in zip(a.w, b.w, strict=True))), *rest)


def chosen(mask: Tensor, a: pair.Seen, b: pair.Seen) -> pair.Seen:
    """a where `mask`, else b."""
    rest = (torch.where(mask, x, y) for x, y in zip(a[1:], b[1:], strict=True))
    return pair.Seen(select(mask, a.w, b.w), *rest)
