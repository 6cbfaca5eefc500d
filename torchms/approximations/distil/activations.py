"""The activations of networks in training, with their slopes."""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from torchms.approximations.network import soft_sign
from torchms.approximations.pair_features import root_sign


class Activation(NamedTuple):
    """A step, and its derivative as a function of the same number."""

    value: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor], Tensor]


SOFT = Activation(soft_sign, lambda z: 1 / (1 + z.abs()) ** 2)
ROOT = Activation(root_sign, lambda z: torch.rsqrt(1 + z * z) ** 3)
