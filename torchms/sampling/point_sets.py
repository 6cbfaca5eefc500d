"""Point sets that all rows of a batch share: scrambled Sobol points and rank-1 lattices."""

import torch
from torch import Tensor
from torch.quasirandom import SobolEngine

BITS = 24
"""Bits of a number: it is a multiple of 2^-24, exact in float32."""

_SHARED: dict[tuple[str, int, int], Tensor] = {}


@torch.compiler.assume_constant_result
def shared_points(sequence: str, n_paths: int, n_uniforms: int) -> Tensor:
    """The points that all rows share, as 24-bit integers (D, N); the last few are remembered."""
    key = (sequence, n_paths, n_uniforms)
    if key not in _SHARED:
        if len(_SHARED) >= 8:
            _SHARED.clear()
        _SHARED[key] = (sobol if sequence == "sobol" else rank1)(n_paths, n_uniforms)
    return _SHARED[key]


def sobol(n_paths: int, n_uniforms: int) -> Tensor:
    """A scrambled Sobol set as 24-bit integers, (D, N); the scrambling is fixed, a row's rotation makes it random."""
    points = SobolEngine(n_uniforms, scramble=True, seed=1).draw(n_paths, dtype=torch.float64)
    return (points.T * (1 << BITS)).to(torch.int64) & ((1 << BITS) - 1)


def rank1(n_paths: int, n_uniforms: int) -> Tensor:
    """A rank-1 lattice as 24-bit integers, (D, N): point i is frac(i · z / N), z built component by component.

    Each component minimises the worst-case error Σ_i Π_d (1 + γ_d 2π² B_2(x)) of the Korobov space with weights
    γ_d = 1 / (d + 1)² [Sloan and Reztsov 2002, "Component-by-component construction of good lattice rules"].
    """
    N = n_paths
    i = torch.arange(N, dtype=torch.float64)
    x = i / N
    kernel = 2 * torch.pi**2 * (x * x - x + 1 / 6)
    candidates = torch.tensor([z for z in range(1, max(2, N // 2 + 1)) if _coprime(z, N)][:512])
    which = (torch.arange(N)[None] * candidates[:, None]) % N
    product = torch.ones(N, dtype=torch.float64)
    columns = []
    for d in range(n_uniforms):
        factors = 1 + kernel[which] / (d + 1) ** 2
        best = 0 if d == 0 else int((factors @ product).argmin())
        product = product * factors[best]
        product = product / product.mean()
        columns.append(which[best])
    return torch.stack(columns) * (1 << BITS) // N


def _coprime(a: int, b: int) -> bool:
    while b:
        a, b = b, a % b
    return a == 1
