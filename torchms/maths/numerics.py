"""Scalar functions with finite gradients, and special functions in forms that export and vectorise.

Everything guards the argument, never the result: `where(bad, 1, x)` before the function, because a guarded result
still has a NaN gradient.
"""

import contextlib

import torch
from torch import Tensor
from torch._C._functorch import peek_interpreter_stack
from torch.autograd import forward_ad
from torch.utils._python_dispatch import _get_current_dispatch_mode_stack


def widened(x: Tensor) -> Tensor:
    """`x` in float32 if its dtype is shorter: guards and constants are those of float32 and float64."""
    return x.float() if torch.finfo(x.dtype).bits < 32 else x


def own_precision(x: Tensor) -> contextlib.AbstractContextManager[object]:
    """Where `torch.autocast` does not shorten what is computed of `x`."""
    kind = x.device.type
    shortened = torch.amp.autocast_mode.is_autocast_available(kind) and torch.is_autocast_enabled(kind)
    return torch.autocast(kind, enabled=False) if shortened else contextlib.nullcontext()


def has_values(x: Tensor) -> bool:
    """Whether the numbers of `x` can be looked at now: those of a meta or a fake tensor cannot."""
    return not x.is_meta and not isinstance(x, torch._subclasses.FakeTensor)


def differentiated(*values: Tensor) -> bool:
    """Whether a derivative with respect to any of these is wanted: if not, holding them is idle."""
    if any(x.requires_grad for x in values):
        return True
    # Forward mode: no level is entered, then there is no tangent. (Asking each tensor takes as long as a small kernel.)
    if torch.compiler.is_compiling() or forward_ad._current_level < 0:
        return False
    return any(forward_ad.unpack_dual(x).tangent is not None for x in values)


def is_readable(x: Tensor) -> bool:
    """Whether a Python number may be made of `x`: nobody traces, records or transforms what is done with it."""
    return (
        has_values(x)
        and not torch.compiler.is_compiling()
        and torch._C._len_torch_dispatch_stack() == 0
        and torch._C._len_torch_function_stack() == 0
        and peek_interpreter_stack() is None
    )


def is_recorded() -> bool:
    """Whether what is done is written down operation by operation, for one element: a look-up by a number cannot be."""
    return any(getattr(mode, "one_element", False) for mode in _get_current_dispatch_mode_stack())


def smallest(dtype: torch.dtype) -> float:
    """Smallest squared length (or radicand) that is treated as positive: far above denormals, far below any use."""
    return 1e-30 if dtype == torch.float32 else 1e-200


def horizon(dtype: torch.dtype) -> float:
    """Least |cos θ| that a division by cos θ sees: 1e-7 in float32, 1e-14 in float64.

    Lambda of a direction closer to the horizon than this is that of this cosine, so it is large but finite.
    """
    return 1e-7 if dtype == torch.float32 else 1e-14


def safe_sqrt(x: Tensor) -> Tensor:
    """√max(x, 0), with a zero gradient where x is not positive."""
    ok = x > smallest(x.dtype)
    return torch.where(ok, torch.sqrt(torch.where(ok, x, 1.0)), 0.0)


def away_from_zero(x: Tensor, least: float) -> Tensor:
    """x with |x| ≥ least, the sign kept (zero counts as positive); no gradient where it was moved."""
    moved = torch.where(x < 0, -least, least).to(x.dtype)
    return torch.where(x.abs() < least, moved, x)


def safe_div(a: Tensor, b: Tensor) -> Tensor:
    """a / b, and 0 with a zero gradient where b is so near zero (1e-15 in float32) that a / b², the gradient, is lost."""
    ok = b.abs() > smallest(b.dtype) ** 0.5
    return torch.where(ok, a, 0.0) / torch.where(ok, b, 1.0)


def score(p: Tensor) -> Tensor:
    """p / p = 1 with the gradient of ln p: what a sample of density p weighs; without a gradient where p is 0."""
    return score_of(p, p)


def score_of(value: Tensor, density: Tensor) -> Tensor:
    """`value` over the `density` that it was drawn with, a constant; 1, without a gradient, where the density is 0."""
    constant = density.detach()
    ok = constant > smallest(constant.dtype)
    return torch.where(ok, value, 1.0) / torch.where(ok, constant, 1.0)


def log1p(x: Tensor) -> Tensor:
    """ln(1 + x) for x > −1, accurate near 0 with exportable operations (Kahan's form: log(u) · x / (u − 1))."""
    u = 1 + x
    small = u == 1
    return torch.where(small, x, torch.log(torch.where(small, 2.0, u)) * x / torch.where(small, 1.0, u - 1))


def expm1(x: Tensor) -> Tensor:
    """exp(x) − 1 for x ≤ 0, accurate near 0 with exportable operations (Kahan's form: (u − 1) · x / log(u))."""
    u = torch.exp(x)
    small = u == 1
    far = u < 0.25
    middle = torch.where(small | far, 0.5, u)
    return torch.where(small, x, torch.where(far, u - 1, (middle - 1) * x / torch.log(middle)))
