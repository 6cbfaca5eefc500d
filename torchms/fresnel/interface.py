"""The boundary between two transparent media: what the slot `fresnel` of rough glass takes."""

import torch
from torch import Tensor

from torchms.fresnel.base import Fresnel


class Interface(Fresnel):
    """A boundary that light also passes; abstract.

    A subclass gives `eta`, `n_channels` and a `reflectance` whose signed cosine tells the side that light comes from:
    outside where cos θ ≥ 0. What is not reflected is transmitted, nothing is absorbed.

    Light of all channels takes the same directions, so there is one `eta` for all of them. A thin film has a
    `reflectance` of its own, in any number of channels, and the eta of the media on its two sides. Dispersion has an eta
    a wavelength along a batch axis: `Dielectric(torch.tensor([1.51, 1.52, 1.53]))` and directions (*batch, 1, 3) give
    values (*batch, 3, 1).
    """

    eta: Tensor
    """n_inside / n_outside, (*batch): what refraction follows."""

    def relative_eta(self, side: Tensor) -> Tensor:
        """n_transmitted / n_incident for light from outside where `side` ≥ 0, from inside where it is negative."""
        return torch.where(side < 0, 1 / self.eta, self.eta)

    def transmittance(self, cos_theta: Tensor, cos_t: Tensor) -> Tensor:
        """Kernel: 1 − reflectance, (C, *any), at signed cosines and those of the directions refracted, cos_t ≥ 0.

        Override it where the difference cancels, near total reflection.
        """
        return 1 - self.reflectance(cos_theta)
