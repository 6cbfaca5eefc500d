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
from torchms.approximations.glass_features import Pair, inputs, pair_of
from torchms.approximations.glass_sampling import GlassRest
from torchms.approximations.network import Network
from torchms.estimators.base import Exit
from torchms.estimators.single_bounce import SingleBounce
from torchms.maths.frame import Vec3
from torchms.paths.refractive import Refractive

EXPONENT = (-30.0, 12.0)
"""Range of ln f: no network that was trained leaves it, and none overflows."""


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

    def facets_of(self, vertex: Refractive) -> Refractive:
        """Facets that further bounces meet."""
        return vertex

    def evaluate(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> list[Tensor]:
        """f · |cos θ_o| [1/sr] of one bounce and of all others together, each (1, 1, …); no order has its own beyond."""
        (first,) = self.single.evaluate(vertex, wi, wo, ())
        factor, further = self.beyond_first(vertex, wi, wo)
        return [first if factor is None else first * factor, *(order[None] for order in further)]

    def beyond_first(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> tuple[Tensor | None, list[Tensor]]:
        """What one bounce is multiplied by, None for 1, and f · |cos θ_o| [1/sr] of three more orders."""
        rest = self.rest(vertex, wi, wo)
        return None, [rest, torch.zeros_like(rest), torch.zeros_like(rest)]

    def once(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> Tensor | None:
        """What one bounce is multiplied by; None for 1."""
        return None

    def walk(self, vertex: Refractive, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        """One bounce, and a direction in which the rest leaves, chosen beforehand about as often as it does."""
        _, side, served = vertex.enter(wi)
        proposal = GlassRest(self.facets_of(vertex))
        again = proposal.share(wi)
        (first,) = self.single.walk(vertex, wi, u)
        escapes, weight = (1 - again).expand_as(first.escapes), first.weight * (first.escapes / (1 - again))
        factor = self.once(vertex, wi, first.d)
        yield Exit(first.d, weight if factor is None else weight * factor, escapes, first.transmitted)
        d = proposal.sample(wi, u[1 + vertex.n_uniforms :])
        density = proposal.density(wi, d)
        can_leave = served & (density > 0)
        _, further = self.beyond_first(vertex, wi, d)
        total = further[0] + further[1] + further[2]
        weight = torch.where(can_leave, total / (torch.where(can_leave, density, 1.0) * again), 0.0)[None]
        transmitted = (d.z > 0) != (side > 0)
        for order in further:
            share = order / torch.where(total > 0, total, 1.0)
            yield Exit(d, weight, (again * share).expand_as(first.escapes), transmitted)

    def rest(self, vertex: Refractive, wi: Vec3, wo: Vec3) -> Tensor:
        """f · |cos θ_o| [1/sr] of all bounces after the first one, without the η² of radiance."""
        found = pair_of(vertex, wi, wo)
        return self.rest_of(found, *inputs(found))

    def rest_of(self, found: Pair, reflected: list[Tensor], transmitted: list[Tensor], of_both: list[Tensor]) -> Tensor:
        """The same, from `inputs`."""
        n_r, n_t = self.reflected(reflected, of_both), self.transmitted(transmitted, of_both)
        value = torch.exp(torch.where(found.crosses, n_t, n_r).clamp(*EXPONENT))
        value = value * scale(found.cos, torch.exp(found.log_eta), found.crosses)
        return torch.where(found.served, value, 0.0)


def scale(cos: Tensor, eta: Tensor, crosses: Tensor | bool) -> Tensor:
    """What exp(n) is multiplied by for f · cos θ_o [1/sr]."""
    factor = cos / math.pi
    if isinstance(crosses, bool):
        return factor * eta if crosses else factor
    return torch.where(crosses, eta, 1.0) * factor
