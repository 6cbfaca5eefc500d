"""What a facet reflects: the slot `fresnel` of every BSDF with smooth facets."""

from abc import ABC, abstractmethod
from typing import Any

import torch
from torch import Tensor

from torchms.module import Parametric, describe
from torchms.typing import Scalar, Spectrum

Value = float | int | list[Any] | tuple[Any, ...] | Tensor
"""What a constructor takes for a parameter: a number, a list of channels, or a tensor, (*batch) or (*batch, C)."""


class Fresnel(Parametric, ABC):
    """Share of the light that a smooth facet reflects, as a function of the angle of incidence; abstract.

    A subclass gives `reflectance` and `n_channels`. Everything is unpolarised and dimensionless.
    """

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

        Every element is computed for its own cosine; a NaN stays a NaN.
        """
        return self.reflectance(cos_theta).movedim(0, -1)

    def extra_repr(self) -> str:
        """The parameters, in full while they are few."""
        return describe(self)


def as_parameter(value: Value) -> float | Tensor:
    """`value` as `Parametric.declare` takes it; a list of channels becomes a tensor."""
    if isinstance(value, list | tuple):
        return torch.tensor(value, dtype=torch.get_default_dtype())
    return float(value) if type(value) is int else value


def from_front(cos_theta: Tensor) -> Tensor:
    """|cos θ|, with the derivative of the front side (+1) at 0, where that of `abs` would be 0."""
    return torch.where(cos_theta < 0, -cos_theta, cos_theta)
