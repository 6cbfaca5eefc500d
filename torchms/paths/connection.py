"""Multiple importance sampling over where two walks are joined.

A path of k bounces can be had as s bounces from wi and t = k − 1 − s from wo, for every s. The balance heuristic weighs
each way by its density: with pf_j and pr_j the densities of vertex j read from wi and from wo, going from s to s − 1
multiplies the density by pr_{s+1} / pf_s. Both sums over the other ways are carried along the walks.
"""

from torch import Tensor

from torchms.maths.numerics import safe_div, smallest
from torchms.paths.vertex import Densities


def extend_alternatives(alternatives: Tensor | None, densities: Densities) -> Tensor:
    """Summed density ratios of the ways that end the walk earlier, without the last factor, after one more bounce.

    α_s = (1 + pr_s α_{s−1}) / pf_s with α_0 = 0 (None).
    """
    once = safe_div(densities.forward.new_ones(()), densities.forward)
    if alternatives is None:
        return once
    # A long product of large ratios overflows where its weight is 0; the gradient of that 0 must not be 0 times infinity.
    total = once + safe_div(densities.backward, densities.forward) * alternatives
    return total.clamp_max(1 / smallest(total.dtype))


def balance(densities: Densities, forward: Tensor | None, backward: Tensor | None) -> Tensor | None:
    """Weight of joining here, 1 / (1 + pr α_s + pf β_t); None where it is 1 because there is no other way."""
    total = None
    if forward is not None:
        total = 1 + densities.backward * forward
    if backward is not None:
        total = (1 if total is None else total) + densities.forward * backward
    return None if total is None else 1 / total
