"""Kinds of facets whose light is learned: what light does on them, and what of Smith's theory is corrected."""

from collections.abc import Callable
from typing import NamedTuple

from torch import Tensor

from torchms.approximations.diffuse_surface_lobes import of_diffuse_smith
from torchms.approximations.distil.rows import Rows
from torchms.approximations.distilled import packaged
from torchms.approximations.distilled_file import Weights
from torchms.approximations.metal_sampling import MetalProposal
from torchms.approximations.surface_lobes import of_smith
from torchms.distributions import Beckmann
from torchms.microsurface.distil.smith import beckmann, smith_diffuse, smith_orders
from torchms.microsurface.simulation.materials import DiffuseFacets, FacetMaterial, MirrorFacets
from torchms.sampling.proposals import HemisphereProposal, Proposal


class Kind(NamedTuple):
    """facets: that reflect all light. smith: f cos θ_o [1/sr] (n, ORDERS) of rows. proposal: where lobes are summed.

    cosines: how many cosines of facets the network says, for a Fresnel term. suffix: of the name of a file that is about such a
    surface, beyond "gaussian" or "scan". base: weights of Smith's lobes.
    """

    facets: FacetMaterial
    smith: Callable[[Rows], Tensor]
    proposal: Callable[[Beckmann], Proposal]
    cosines: int
    suffix: str
    base: Callable[[], tuple[Weights, ...]]


KINDS = {
    "conductor": Kind(MirrorFacets(), smith_orders, MetalProposal, 3, "", lambda: of_smith(beckmann())),
    "diffuse": Kind(
        DiffuseFacets(),
        smith_diffuse,
        HemisphereProposal,
        0,
        "_diffuse",
        lambda: of_diffuse_smith(packaged("Beckmann", "diffuse")),
    ),
}
"""By the names of materials on command lines."""
