"""What a facet reflects: the slot `fresnel` of every BSDF with smooth facets."""

import math
from abc import ABC, abstractmethod

import torch
from torch import Tensor

from torchms.maths.frame import kind_of
from torchms.maths.numerics import widened
from torchms.parameters.declared import Parametric, describe
from torchms.parameters.maps import fitted
from torchms.typing import Scalar, Spectrum


class Fresnel(Parametric, ABC):
    """Share of the light that a smooth facet reflects, as a function of the angle of incidence; abstract.

    A subclass gives `reflectance` and `n_channels`. Everything is unpolarised and dimensionless.
    """

    is_lossless: bool = False
    """Whether a facet reflects all light, so that nothing is lost on it."""

    @property
    @abstractmethod
    def n_channels(self) -> int:
        """C, the length of the last axis that `forward` returns."""
        raise NotImplementedError

    @abstractmethod
    def reflectance(self, cos_theta: Tensor) -> Tensor:
        """Kernel: reflectance, channels first, (C, *any) for cosines (*any).

        Parameters of shape (*batch, C) line up with the last axes of `cos_theta`, so it may lead with a path axis.
        """
        raise NotImplementedError

    def forward(self, cos_theta: Scalar) -> Spectrum:
        """Reflectance [1], in [0, 1] up to rounding, of a facet met at `cos_theta` = w · m; channels last.

        Every element is computed for its own cosine; a NaN stays a NaN. Raises TypeError if it is no floating tensor,
        ValueError for a gray map (H, W) of a parameter with channels beside cosines (H, W): give it as (H, W, 1).
        """
        if not isinstance(cos_theta, Tensor) or not cos_theta.is_floating_point():
            raise TypeError(f"cos_theta must be a floating-point Tensor (*batch); got {kind_of(cos_theta)}.")
        F = fitted(self, cos_theta.shape).reflectance(widened(cos_theta)).movedim(0, -1)
        return torch.where(cos_theta.isnan().unsqueeze(-1), math.nan, F)

    def extra_repr(self) -> str:
        """The parameters, in full while they are few."""
        return describe(self)


def from_front(cos_theta: Tensor) -> Tensor:
    """|cos θ|, with the derivative of the front side (+1) at 0, where that of `abs` would be 0."""
    return torch.where(cos_theta < 0, -cos_theta, cos_theta)
