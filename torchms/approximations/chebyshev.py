"""Chebyshev series over several axes, evaluated without a gather: basis values and products only.

A series of degree n is smooth everywhere, differentiable, and made of operations that compile and export.
"""

import torch
from torch import Tensor


def polynomials(x: Tensor, degree: int) -> Tensor:
    """T_0(x) … T_degree(x), stacked in front: (degree + 1, *x.shape); x is kept within [−1, 1]."""
    x = x.clamp(-1.0, 1.0)
    found = [torch.ones_like(x), x]
    for _ in range(degree - 1):
        found.append(2 * x * found[-1] - found[-2])
    return torch.stack(found[: degree + 1])


def outer(a: Tensor, b: Tensor) -> Tensor:
    """All products of two stacks, (m, *a) and (n, *b) → (m n, …); the shapes a and b broadcast."""
    ndim = max(a.ndim, b.ndim)
    a = a.reshape(len(a), 1, *(1,) * (ndim - a.ndim), *a.shape[1:])
    b = b.reshape(1, len(b), *(1,) * (ndim - b.ndim), *b.shape[1:])
    return (a * b).flatten(0, 1)


def contracted(coefficients: Tensor, basis: Tensor) -> Tensor:
    """Σ_j coefficients[…, j] · basis[j, …]: (*lead, J) and (J, *shape) → (*lead, *shape)."""
    # A product promotes dtypes, a contraction does not: directions may be float64 where the table is float32.
    dtype = torch.promote_types(coefficients.dtype, basis.dtype)
    return torch.tensordot(coefficients.to(dtype), basis.to(dtype), dims=1)


def summed(coefficients: Tensor, basis: Tensor) -> Tensor:
    """Σ_i coefficients[i, …] · basis[i, …], where the coefficients have a shape of their own that broadcasts.

    (n, *own) and (n, *shape) → (*shape); `own` lines up with the last axes of `shape`.
    """
    own = coefficients.shape[1:]
    if not own:
        return contracted(coefficients, basis)
    missing = (1,) * (basis.ndim - 1 - len(own))
    return (coefficients.reshape(-1, *missing, *own) * basis).sum(0)
