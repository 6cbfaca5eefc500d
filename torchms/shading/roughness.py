"""α from what others call roughness."""

import math
from collections.abc import Callable
from typing import TypeVar

import torch
from torch import Tensor

from torchms.maths.numerics import has_values, safe_sqrt
from torchms.parameters.declared import first_bad

Number = float | Tensor
T = TypeVar("T")

LEAST_PBRT3 = 1e-3
"""What pbrt-v3 takes a smaller roughness for."""


def _squared(r: Tensor) -> Tensor:
    return r * r


def _pbrt3(r: Tensor) -> Tensor:
    x = torch.log(r.clamp_min(LEAST_PBRT3))
    return 1.62142 + x * (0.819955 + x * (0.1734 + x * (0.0171201 + x * 0.000640711)))


CONVENTIONS: dict[str, tuple[Callable[[Tensor], Tensor], str, str]] = {
    "alpha": (lambda r: r, "α = r", "the roughness is α itself"),
    "gltf": (_squared, "α = r²", "glTF 2.0 Specification, Appendix B"),
    "disney": (_squared, "α = r²", "[Burley2012], section 5.4"),
    "unreal": (_squared, "α = r²", "Karis 2013, Real Shading in Unreal Engine 4, SIGGRAPH course"),
    "mitsuba": (lambda r: r, "α = r", "Mitsuba 3, `alpha` of `roughconductor` and `roughdielectric`"),
    "mitsuba-principled": (_squared, "α = r²", "Mitsuba 3, `roughness` of `principled`"),
    "pbrt": (safe_sqrt, "α = √r", "pbrt-v4, `remaproughness`; Physically Based Rendering, 4th ed., section 9.6"),
    "pbrt-v3": (
        _pbrt3,
        "α = 1.62142 + 0.819955 x + 0.1734 x² + 0.0171201 x³ + 0.000640711 x⁴, x = ln max(r, 0.001)",
        "pbrt-v3, `remaproughness`; Physically Based Rendering, 3rd ed., section 8.4",
    ),
}
"""Name → α of a roughness in [0, 1], the formula, and its source."""


def _gltf(r: Tensor, strength: Tensor) -> tuple[Tensor, Tensor]:
    # KHR_materials_anisotropy: along the tangent α grows to 1, across it stays.
    along = r * r
    return along + (1 - along) * strength * strength, along


def _disney(r: Tensor, anisotropic: Tensor) -> tuple[Tensor, Tensor]:
    # [Burley2012], section 5.4: aspect = √(1 − 0.9 anisotropic), α_x = r² / aspect, α_y = r² aspect.
    aspect = torch.sqrt(1 - 0.9 * anisotropic)
    return r * r / aspect, r * r * aspect


ANISOTROPIES: dict[str, tuple[Callable[[Tensor, Tensor], tuple[Tensor, Tensor]], str, str]] = {
    "gltf": (_gltf, "α_x = r² + (1 − r²) a², α_y = r²", "glTF 2.0, KHR_materials_anisotropy"),
    "disney": (_disney, "α_x = r² / √(1 − 0.9 a), α_y = r² √(1 − 0.9 a)", "[Burley2012], section 5.4"),
}
"""Name → α_x along the tangent and α_y across, of roughness and anisotropy in [0, 1], the formula, and its source."""


def alpha(roughness: Number, convention: str = "gltf", *, least: float = 0.0) -> Tensor:
    """α of a `roughness` in [0, 1], a number or a map (*batch), as the `convention` has it: see `CONVENTIONS`.

    least: what a smaller α becomes; distributions take α from 1e-3 on, and maps have zeros. Differentiable. Raises
    ValueError for an unknown convention and, where the numbers are known, for a roughness outside of [0, 1].
    """
    function, _, _ = _known(convention, CONVENTIONS, "alpha")
    return function(_checked(roughness, "roughness", "alpha")).clamp_min(_least(least))


def alphas(
    roughness: Number, anisotropy: Number, convention: str = "gltf", *, least: float = 0.0
) -> tuple[Tensor, Tensor]:
    """(α_x, α_y) of a `roughness` and an `anisotropy` in [0, 1]: see `ANISOTROPIES`; x is the tangent.

    least: as for `alpha`. Raises ValueError for an unknown convention and for numbers outside of [0, 1].
    """
    function, _, _ = _known(convention, ANISOTROPIES, "alphas")
    given = _checked(roughness, "roughness", "alphas"), _checked(anisotropy, "anisotropy", "alphas")
    x, y = function(*given)
    return x.clamp_min(_least(least)), y.clamp_min(least)


def _known(convention: str, table: dict[str, T], owner: str) -> T:
    if convention not in table:
        raise ValueError(f"{owner}(convention=...) must be one of {', '.join(table)}; got {convention!r}.")
    return table[convention]


def _least(least: float) -> float:
    if not (math.isfinite(least) and 0 <= least <= 1):
        raise ValueError(f"least must lie in [0, 1]; got {least:g}. 1e-3 is the smallest alpha of a distribution.")
    return least


def _checked(value: Number, name: str, owner: str) -> Tensor:
    x = value if isinstance(value, Tensor) else torch.tensor(float(value), dtype=torch.get_default_dtype())
    if not x.is_floating_point():
        raise TypeError(f"{owner}({name}=...) must be a float or a floating-point Tensor (*batch); got {x.dtype}.")
    if has_values(x) and not torch.compiler.is_compiling():
        bad = ~((x >= 0) & (x <= 1)).detach()
        if bool(bad.any()):
            raise ValueError(
                f"{owner}({name}=...) must lie in [0, 1]; got {first_bad(bad, x)}. Rescale or clamp the map."
            )
    return x
