"""Schlick's approximation: a reflectance curve from its value at normal incidence."""

from torch import Tensor

from torchms.fresnel.base import Fresnel, from_front
from torchms.parameters.declared import Value, channels_first


class Schlick(Fresnel):
    """Reflectance f0 + (1 − f0)(1 − |cos θ|)⁵ [1].

    `f0`, the reflectance at normal incidence, in [0, 1], is a number or has shape (*batch, C). Raises ValueError
    outside that range. Source: Schlick 1994, "An Inexpensive BRDF Model for Physically-based Rendering", Eq. 15.
    """

    f0: Tensor

    def __init__(self, f0: Value) -> None:
        super().__init__()
        self.declare(
            "f0",
            f0,
            low=0.0,
            high=1.0,
            channels=True,
            remedy="It is a reflectance; from refractive indices use Conductor(eta, k) or Dielectric(eta).",
        )

    @property
    def n_channels(self) -> int:
        """Number of channels of f0."""
        return self.f0.shape[-1]

    def reflectance(self, cos_theta: Tensor) -> Tensor:
        """Kernel: (C, *any) for cosines (*any); the sign of the cosine does not matter."""
        f0 = channels_first(self.f0, cos_theta.ndim)
        x = 1 - from_front(cos_theta)
        x2 = x * x
        return f0 + (1 - f0) * (x2 * x2 * x)
