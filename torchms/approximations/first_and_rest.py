"""One bounce, exact, and one more term for everything that bounces again."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from torchms.estimators.base import Exit, Scattering
from torchms.estimators.single_bounce import SingleBounce
from torchms.maths.frame import Vec3
from torchms.maths.numerics import horizon
from torchms.paths.diffuse import Diffuse
from torchms.paths.mirror import Mirror
from torchms.paths.vertex import Vertex
from torchms.sampling.warps import cosine_hemisphere

OWNERS: dict[type[Vertex], str] = {Mirror: "RoughConductor", Diffuse: "RoughDiffuse"}


class FirstAndRest(Scattering):
    """Order 1 is the single bounce, order 2 stands for all further ones together; abstract.

    A subclass gives `multiple`, what bounces again, and says `is_reciprocal`. `walk` draws its directions in proportion to
    the cosine; where that does not fit, or light gets through, a subclass has a walk of its own.
    facets: the kinds of facet that it knows; others are refused with a ValueError.
    """

    max_order = 2
    is_unbiased = False
    facets: tuple[type[Vertex], ...] = (Mirror, Diffuse)

    def __init__(self) -> None:
        super().__init__()
        self.single = SingleBounce()

    def n_extra(self, vertex: Vertex) -> int:
        """Random numbers of an exit after more than one bounce."""
        return 2

    def n_uniforms(self, vertex: Vertex) -> int:
        return self.single.n_uniforms(vertex) + self.n_extra(vertex)

    def is_deterministic(self, vertex: Vertex) -> bool:
        return self.single.is_deterministic(vertex)

    def check(self, vertex: Vertex) -> None:
        if type(vertex) not in self.facets:
            owners = " or a ".join(OWNERS[kind] for kind in self.facets)
            raise ValueError(
                f"{type(self).__name__} knows nothing of {type(vertex).__name__.lower()} facets. Use it in a {owners}, or "
                "a scattering that holds for them, such as HeightWalk()."
            )

    def evaluate(self, vertex: Vertex, wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
        (single,) = self.single.evaluate(vertex, wi, wo, u)
        further = self.multiple(vertex, wi, wo, single)
        return [single, torch.where(vertex.serves(wi) & vertex.serves(wo), further, 0.0)]

    def walk(self, vertex: Vertex, wi: Vec3, u: Sequence[Tensor]) -> Iterator[Exit]:
        # Either term is taken in half of the cases, whatever the share of the other, and counts twice.
        (first,) = self.single.walk(vertex, wi, u)
        half = torch.full_like(first.escapes, 0.5)
        yield Exit(first.d, 2 * first.escapes * first.weight, half, first.transmitted)
        d = cosine_hemisphere(*u[self.single.n_uniforms(vertex) :][:2])
        d = Vec3(d.x, d.y, d.z.clamp_min(horizon(d.z.dtype)))
        further = self.evaluate(vertex, wi, d, u)[1]
        yield Exit(d, further * (2 * torch.pi / d.z), half, first.transmitted)

    @abstractmethod
    def multiple(self, vertex: Vertex, wi: Vec3, wo: Vec3, single: Tensor) -> Tensor:
        """f · |cos θ_o| of all bounces after the first [1/sr], (C, 1, …); `single` is that of the first."""
