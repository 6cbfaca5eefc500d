"""One bounce off GGX facets as rendering code in PyTorch writes it, limits and small addends included.

Sources: Karis 2013, Real Shading in Unreal Engine 4, SIGGRAPH course; Schlick 1994, "An Inexpensive BRDF Model for
Physically-based Rendering"; [Walter2007]; [Heitz2014] for the correlated form of Smith's masking.
"""

import math

import torch
from torch import Tensor

from torchms.dropins.cosines import Cosines

KARIS = (-5.55473, -6.98316)
"""(1 − c)⁵ ≈ 2^((a c + b) c), Karis 2013."""
LEAST_COSINE, LEAST_DENOMINATOR = 1e-6, 1e-6
"""Of `schlick_masking`."""
SMITH_EDGE = 1e-4
"""Cosines are kept so far from 0 and 1 by `smith`."""
ADDEND = 1e-7
"""What `cook_torrance` adds to its denominators."""


def stretched(half: Tensor, alpha2: Tensor) -> Tensor:
    """q = 1 + cos² (α² − 1) of the half vector: GGX has D = α² / (π q²)."""
    return half * half * (alpha2 - 1) + 1


def masked(cosine: Tensor, k: Tensor) -> Tensor:
    """Schlick's cos / G1 = cos (1 − k) + k."""
    return cosine * (1 - k) + k


def hotness(roughness: Tensor) -> Tensor:
    """k = (r + 1)² / 8: Karis 2013, for lights that are points."""
    return (roughness + 1) * (roughness + 1) / 8


def raised(f0: Tensor, weight: Tensor) -> Tensor:
    """F0 + (1 − F0) weight, (*batch, C)."""
    return f0 + (1 - f0) * weight.unsqueeze(-1)


def schlick_weight(met: Tensor) -> Tensor:
    """(1 − c)⁵."""
    x = 1 - met
    x2 = x * x
    return x2 * x2 * x


def schlick_masking(at: Cosines, roughness: Tensor, f0: Tensor) -> Tensor:
    """D F G / (4 cos cos) [1/sr], no cosine, (*batch, C): α = r², Schlick's masking with k = (r + 1)² / 8.

    Its denominator is 1e-6 at least, which cuts highlights of r below about 0.17.
    """
    at = at.clamped(LEAST_COSINE)
    alpha = roughness * roughness
    q, k = stretched(at.half, alpha * alpha), hotness(roughness)
    below = 4 * math.pi * (q * q) * masked(at.view, k) * masked(at.light, k)
    a, b = KARIS
    F = raised(f0, torch.exp2((a * at.met + b) * at.met))
    return F * (alpha * alpha / below.clamp(LEAST_DENOMINATOR, 4 * math.pi)).unsqueeze(-1)


def smith(at: Cosines, alpha: Tensor, f0: Tensor) -> Tensor:
    """D F G / (4 cos cos) · cos θ_light [1/sr], (*batch, C), G correlated; 0 where a cosine is below 1e-4."""
    front = (at.view > SMITH_EDGE) & (at.light > SMITH_EDGE)
    at = at.clamped(SMITH_EDGE, 1 - SMITH_EDGE)
    alpha2 = alpha * alpha
    q = stretched(at.half, alpha2)
    both = 0.5 * (root(at.view, alpha2) + root(at.light, alpha2))
    value = alpha2 / (math.pi * q * q) / (4 * both * at.view)
    return torch.where(front.unsqueeze(-1), raised(f0, schlick_weight(at.met)) * value.unsqueeze(-1), 0.0)


def root(cosine: Tensor, alpha2: Tensor) -> Tensor:
    """1 + 2 Λ = √(1 + α² tan²)."""
    cos2 = cosine * cosine
    return torch.sqrt(1 + alpha2 * ((1 - cos2) / cos2))


def cook_torrance(at: Cosines, roughness: Tensor, base: Tensor, f0: Tensor, metallic: Tensor | None) -> Tensor:
    """The value times cos θ_light [1/sr], (*batch, C): α = r, k = (r + 1)² / 8, and (1 − F)(1 − metallic) base / π below."""
    at = at.clamped(0.0)
    alpha2 = roughness * roughness
    q, k = stretched(at.half, alpha2), hotness(roughness)
    D = alpha2 / (math.pi * (q * q) + ADDEND)
    G = at.view / (masked(at.view, k) + ADDEND) * (at.light / (masked(at.light, k) + ADDEND))
    F = raised(f0, schlick_weight(at.met))
    specular = F * (D * G / (4 * at.view * at.light + ADDEND)).unsqueeze(-1)
    left = 1 - F if metallic is None else (1 - F) * (1 - metallic.unsqueeze(-1))
    return (left * base / math.pi + specular) * at.light.unsqueeze(-1)
