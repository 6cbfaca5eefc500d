"""The white furnace: a surface that absorbs nothing gives all light back."""

from torch import Tensor

from torchms.bsdfs.base import BSDF
from torchms.testing.zscore import Estimate, estimate, exactly


def white_furnace(bsdf: BSDF, wi: Tensor, u: Tensor) -> Estimate:
    """Energy that leaves on either side, all orders and channels, of light from each `wi` (*batch, 3): (*batch, C).

    For lossless facets it is 1, less what has not left after `max_order` bounces. `u` from `bsdf.uniforms` (*batch, N, D);
    its N paths, two at least, are what the standard error is over; there is none where the surface `knows_energies`. Raises
    TypeError if `bsdf` is none, or `u` no tensor.
    """
    if not isinstance(bsdf, BSDF) or not isinstance(u, Tensor):
        raise TypeError(
            "white_furnace(bsdf, wi, u) takes a BSDF and the tensor of numbers that its uniforms() gives; "
            f"got {type(bsdf).__name__} and {type(u).__name__}."
        )
    if bsdf.knows_energies:
        return exactly(bsdf.albedo(wi).reflected.sum(-2))
    energies = bsdf.albedo(wi.unsqueeze(-2), u.unsqueeze(-2))
    total = (energies.reflected + energies.transmitted).sum(-2)
    return estimate(total, dim=-2)
