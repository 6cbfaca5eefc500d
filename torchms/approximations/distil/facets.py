"""The network of the facets that each order meets: a fit to what probes of the Fresnel term show, by L-BFGS."""

from collections.abc import Callable

import torch
from torch import Tensor

from torchms.approximations.facet_reflectance import MEANS, met
from torchms.approximations.network import Layer, folded, soft_sign
from torchms.sampling.uniforms import draw, generator_for

ROWS = 1 << 19
"""Rows that the network is fitted to."""
CHUNK = 1 << 17
OUTPUTS = 3 * MEANS
SCALES = (4.0, 1.0, 1.0, 8.0)
"""How much reflectances change with s, p, q, and with the mean of s at both facets of a pair: those of a dielectric."""


def fitted(
    features: Tensor,
    targets: Tensor,
    rest: Tensor,
    weight: Tensor,
    units: int,
    steps: int,
    seed: int,
    advance: Callable[[int], None],
) -> tuple[list[Layer], Tensor]:
    """Layers and linear part.

    features (n, K): as they are. targets (n, COLUMNS): see `targets`. rest (n): bounces after the fourth, of light that has
    come to it. weight (n): of a row's squares, in units of 1 / f².
    """
    features, targets, rest, weight = (x[:ROWS] for x in (features, targets, rest, weight))
    mean, spread = features.mean(0), features.std(0)
    inputs = (features - mean) / spread
    f, moments = targets[:, 1:4], targets[:, 5:].unflatten(1, (3, MEANS))
    # Facets, and pairs of them, of all light of an order; those after the fourth are geometrically distributed.
    counts = torch.stack([2 * f[:, 0], 3 * f[:, 1], targets[:, 4]], -1)
    pairs = torch.stack([f[:, 0], 3 * f[:, 1], (6 + rest * (4 + rest)) * f[:, 2]], -1)
    parameters = _initial(inputs.shape[1], units, seed)
    optimizer = torch.optim.LBFGS(parameters, max_iter=steps, history_size=30, line_search_fn="strong_wolfe")

    def value() -> Tensor:
        optimizer.zero_grad(set_to_none=True)
        whole = torch.zeros(())
        for some in torch.arange(len(inputs)).split(CHUNK):
            rows = slice(int(some[0]), int(some[-1]) + 1)
            found = _squares(_outputs(parameters, inputs[rows]), counts[rows], pairs[rows], moments[rows], weight[rows])
            (found / len(inputs)).backward()
            whole = whole + found.detach() / len(inputs)
        return whole

    optimizer.step(value)
    advance(steps)
    first, shift, last, offset, skip = (x.detach() for x in parameters)
    return folded([(first, shift), (last, offset)], skip, mean, spread)


def _initial(inputs: int, units: int, seed: int) -> list[Tensor]:
    """Layers and linear part to begin with."""
    u = 2 * draw((units, inputs + 1), 1, 1, generator=generator_for(seed))[..., 0, 0] - 1
    zeros = torch.zeros(OUTPUTS, units), torch.zeros(OUTPUTS), torch.zeros(OUTPUTS, inputs)
    return [x.clone().requires_grad_(True) for x in (u[:, :-1] * 2 / inputs**0.5, u[:, -1], *zeros)]


def _outputs(parameters: list[Tensor], inputs: Tensor) -> Tensor:
    first, shift, last, offset, skip = parameters
    return torch.addmm(offset, soft_sign(torch.addmm(shift, inputs, first.T)), last.T) + inputs @ skip.T


def _squares(outputs: Tensor, counts: Tensor, pairs: Tensor, moments: Tensor, weight: Tensor) -> Tensor:
    """Weighted squares, summed over the rows."""
    whole = torch.zeros(())
    for k, each in enumerate(met(outputs.unbind(-1))):
        count, pair = counts[:, k], pairs[:, k]
        found = count * each.s, count * each.p, count * each.q, pair * (each.s.detach() ** 2 * (1 + each.spread))
        off = torch.stack(found, -1) - moments[:, k]
        whole = whole + (weight[:, None] * (off * torch.tensor(SCALES)) ** 2).sum()
    return whole
