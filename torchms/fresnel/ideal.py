"""The lossless mirror: what white-furnace tests are made of."""

import torch
from torch import Tensor

from torchms.fresnel.base import Fresnel


class Ideal(Fresnel):
    """Reflectance 1 at every angle, one channel."""

    is_lossless = True

    @property
    def n_channels(self) -> int:
        """1."""
        return 1

    def reflectance(self, cos_theta: Tensor) -> Tensor:
        """Kernel: ones of shape (1, *any)."""
        return torch.ones_like(cos_theta).unsqueeze(0)
