"""Helmholtz reciprocity: f(wi, wo) / η² is the same both ways."""

import torch
from torch import Tensor

from torchms.bsdfs.base import BSDF
from torchms.bsdfs.rough_dielectric import RoughDielectric
from torchms.testing.zscore import Estimate, estimate


def reciprocity(
    bsdf: BSDF, wi: Tensor, wo: Tensor, u: Tensor | None = None, u_back: Tensor | None = None
) -> tuple[Estimate, Estimate]:
    """Estimates (*batch, K, C) of two numbers that are equal for a reciprocal BSDF, order by order.

    wi, wo: (*batch, 3). u, u_back: independent `bsdf.uniforms` (*batch, N, D) for the two ways; a deterministic BSDF needs
    none, its numbers have no error. The numbers are f · |cos θ_i| |cos θ_o| n_i²; in a dielectric of mode "radiance" the way
    back is divided by n², as the value there is. Raises TypeError if `bsdf` is none, ValueError if numbers are missing.
    """
    if not isinstance(bsdf, BSDF):
        raise TypeError(f"reciprocity(bsdf, ...) takes a BSDF; got {type(bsdf).__name__}.")
    there = _orders(bsdf, wi, wo, u)
    back = _orders(bsdf, wo, wi, u_back)
    return _scaled(there, flux(bsdf, wi, wo)), _scaled(back, flux(bsdf, wo, wi))


def _scaled(value: Estimate, factor: Tensor) -> Estimate:
    return Estimate(value.mean * factor, value.stderr * factor, value.n)


def _orders(bsdf: BSDF, wi: Tensor, wo: Tensor, u: Tensor | None) -> Estimate:
    if bsdf.scattering.is_deterministic(bsdf.vertex):
        value = bsdf.orders(wi, wo).detach().double()
        return Estimate(value, torch.zeros_like(value), 1)
    if u is None:
        raise ValueError("reciprocity(u=..., u_back=...) are needed: the values of this BSDF are estimates.")
    return estimate(bsdf.orders(wi.unsqueeze(-2), wo.unsqueeze(-2), u.unsqueeze(-2)), dim=-3)


def flux(bsdf: BSDF, w: Tensor, d: Tensor) -> Tensor:
    """What a value f · |cos θ_d| of light from `w` is multiplied by: |cos θ_w|, and the étendue's n² on the one side."""
    flux = w[..., 2].abs().double()
    if isinstance(bsdf, RoughDielectric):
        # Importance: n_w² f |cos w| |cos d| is symmetric. Radiance: its value was divided by (n_d / n_w)² already.
        side = d if bsdf.mode == "radiance" else w
        n = torch.where(side[..., 2] < 0, bsdf.fresnel.eta, 1.0)
        flux = flux * n * n
    return flux[..., None, None]
