"""The checked mode: whether directions are looked at before they are used."""

from collections.abc import Mapping

import torch
from torch import Tensor
from torch._C._functorch import is_functorch_wrapped_tensor

from torchms.module import first_bad

UNIT = 1e-3
"""Most that |w|² of a direction may differ from 1; a few units in the last place for shorter dtypes."""

CHUNK = 16384
"""Rows that are looked at together: what is computed of them stays in the cache."""

_checked = True


def set_validation(enabled: bool) -> bool:
    """Switch the checked mode on (as it is at first) or off, for the whole process; returns what it was.

    Checked, every method of a BSDF raises ValueError for a direction that is NaN, infinite or not of unit length
    (| |w|² − 1 | ≤ 1e-3): one pass over the directions, 2 to 3 ns each. Unchecked, they are used as they are: a NaN
    gives a row that is 0 or NaN, another length gives the value of no surface, and other rows keep their bits and their
    gradients either way. While a graph is traced (`torch.compile`, `torch.export`, ONNX, fake tensors) and inside
    `torch.func` transforms of the directions nothing is checked. Raises TypeError if `enabled` is not a bool.
    """
    global _checked
    if not isinstance(enabled, bool):
        raise TypeError(f"set_validation(enabled) must be True or False; got {enabled!r}.")
    before, _checked = _checked, enabled
    return before


def check_unit(directions: Mapping[str, Tensor]) -> None:
    """Raise ValueError, in checked mode, for the first direction (*batch, 3) that is not of unit length."""
    if not _checked or torch.compiler.is_compiling():
        return
    for name, w in directions.items():
        if not w.numel() or _has_no_values(w):
            continue
        with torch.no_grad():
            # What is the same along an axis is looked at once.
            seen = w[tuple(slice(0, 1) if stride == 0 else slice(None) for stride in w.stride()[:-1])].detach()
            slack = max(UNIT, 4 * torch.finfo(w.dtype).eps)
            if any(_strays(part, slack) for part in seen.reshape(-1, 3).split(CHUNK)):
                _refuse(name, w.detach(), slack)


def _strays(w: Tensor, slack: float) -> bool:
    """Whether some |w|² is not within `slack` of 1."""
    x, y, z = w.unbind(-1)
    low, high = torch.aminmax((x * x).addcmul_(y, y).addcmul_(z, z))
    # Also where one is NaN, which `aminmax` hands on.
    return not (float(low) >= 1 - slack and float(high) <= 1 + slack)


def _has_no_values(w: Tensor) -> bool:
    """Whether `w` stands for values that are not known now: traced, fake, or one of many under a transform."""
    return isinstance(w, torch._subclasses.FakeTensor) or is_functorch_wrapped_tensor(w)


def _refuse(name: str, w: Tensor, slack: float) -> None:
    length2 = (w * w).sum(-1)
    bad = ~((length2 - 1).abs() <= slack)
    flat = int(bad.reshape(-1).to(torch.uint8).argmax())
    value = ", ".join(f"{x:g}" for x in w.reshape(-1, 3)[flat].tolist())
    raise ValueError(
        f"{name} must hold unit vectors: |{name}|² within {slack:g} of 1; got {first_bad(bad, length2)}, where {name} = "
        f"({value}). Use torch.nn.functional.normalize({name}, dim=-1), or torchms.set_validation(False) to skip this check."
    )
