"""The kernels of a BSDF: functions of components. Values are (C, N, …) with N = 1 where nothing was drawn."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchms.evaluation.kernel import Kernel
from torchms.maths.frame import Vec3

if TYPE_CHECKING:
    from torchms.bsdfs.base import BSDF


def _values(bsdf: "BSDF", wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> list[Tensor]:
    values = [value.mean(1) for value in bsdf._evaluate(wi, wo, u)]
    unit = bsdf._unit_of(wi, wo)
    return values if unit is None else [value * unit for value in values]


def _forward(bsdf: "BSDF", wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> tuple[Tensor, ...]:
    first, *rest = _values(bsdf, wi, wo, u)
    return (sum(rest, first),)


def _orders(bsdf: "BSDF", wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> tuple[Tensor, ...]:
    return (torch.stack(torch.broadcast_tensors(*_values(bsdf, wi, wo, u))),)


def _sample(bsdf: "BSDF", wi: Vec3, u: Sequence[Tensor]) -> tuple[Tensor, ...]:
    wo = bsdf.proposal.sample(wi, u)
    pdf = bsdf.proposal.density(wi, wo)
    return torch.stack(torch.broadcast_tensors(*wo)), pdf


def _pdf(bsdf: "BSDF", wi: Vec3, wo: Vec3, u: Sequence[Tensor]) -> tuple[Tensor, ...]:
    return (bsdf.proposal.density(wi, wo).mean(0),)


def _walk(bsdf: "BSDF", wi: Vec3, u: Sequence[Tensor]) -> tuple[Tensor, ...]:
    # The escape probabilities of one walk sum to one: number 0 picks the bounce after which it leaves.
    left = torch.zeros_like(u[0])
    x, y, z = torch.zeros_like(left), torch.zeros_like(left), torch.ones_like(left)
    order = torch.zeros_like(left)
    weight: Tensor | None = None
    for k, leaving in enumerate(bsdf._walk(wi, u), start=1):
        after = left + leaving.escapes
        now = (u[0] >= left) & (u[0] < after)
        left = after
        carried = leaving.weight
        unit = bsdf._unit_of(wi, leaving.d)
        if unit is not None:
            carried = carried * unit
        x, y, z = torch.where(now, leaving.d.x, x), torch.where(now, leaving.d.y, y), torch.where(now, leaving.d.z, z)
        order = torch.where(now, float(k), order)
        weight = torch.where(now, carried, 0.0 if weight is None else weight)
    assert weight is not None
    return torch.stack(torch.broadcast_tensors(x, y, z)), weight, order


def _albedo(bsdf: "BSDF", wi: Vec3, u: Sequence[Tensor]) -> tuple[Tensor, ...]:
    if bsdf.knows_energies:
        found = torch.stack(torch.broadcast_tensors(*bsdf._energies(wi))).mean(2)
        return found, torch.zeros_like(found)
    reflected, transmitted = [], []
    for leaving in bsdf._walk(wi, u):
        energy = leaving.weight * leaving.escapes
        reflected.append(torch.where(leaving.transmitted, 0.0, energy).mean(1))
        transmitted.append(torch.where(leaving.transmitted, energy, 0.0).mean(1))
    return torch.stack(torch.broadcast_tensors(*reflected)), torch.stack(torch.broadcast_tensors(*transmitted))


def _is_estimate(bsdf: "BSDF") -> bool:
    """Whether a value is an estimate, not a number that is the same at every call."""
    return not bsdf.scattering.is_deterministic(bsdf.vertex)


FORWARD = Kernel("forward", _forward, draws=_is_estimate)
ORDERS = Kernel("orders", _orders, draws=_is_estimate)
SAMPLE = Kernel("sample", _sample, per_path=True)
PDF = Kernel("pdf", _pdf, draws=lambda bsdf: False)
WALK = Kernel("sample_walk", _walk, per_path=True)
ALBEDO = Kernel("albedo", _albedo, draws=lambda bsdf: not bsdf.knows_energies)
