"""Gaussian random heights with given slopes: a Beckmann microsurface (docs/theory.md, section 10)."""

import math

import numpy as np

from torchms.microsurface.surfaces.differences import forward, rms

# Second derivative of a Gaussian-correlated surface: rms h'' = √6 · (rms h') / l with C(r) = exp(−r²/l²), so the rms
# change of slope from one texel to the next is √6 · (α/√2) · texel / l = √3 α / texels_per_correlation.
SLOPE_CHANGE_PER_TEXEL = math.sqrt(3)
MAX_SLOPE_CHANGE = 0.25
MIN_CORRELATIONS = 8


def gaussian_heights(
    alpha: float, alpha_y: float, size: int, texels_per_correlation: float | int, seed: int
) -> tuple[np.ndarray, tuple[float, float]]:
    """Heights (size, size) with slope variances α_x²/2, α_y²/2, and the spacing (dx, dy) at which they have them.

    Raises ValueError if the texels cannot resolve the slopes, and says the size that can.
    """
    check_resolution(max(alpha, alpha_y), size, texels_per_correlation)
    h = _correlated_noise(size, texels_per_correlation, seed)
    dx = 1.0 / texels_per_correlation
    h *= alpha / math.sqrt(2) / (rms(forward(h, 0)) / dx)
    dy = rms(forward(h, 1)) / (alpha_y / math.sqrt(2))
    return h, (dx, dy)


def checked_alpha(alpha: float | int, name: str) -> float:
    """`alpha` if a surface can have it, or ValueError."""
    if not (math.isfinite(alpha) and 1e-3 <= alpha <= 2):
        raise ValueError(f"{name} must lie in [1e-3, 2]; got {alpha}. A mirror is the limit alpha -> 0.")
    return float(alpha)


def check_resolution(alpha: float, size: int, texels_per_correlation: float | int) -> None:
    """Raise ValueError if `size` texels at this resolution cannot carry slopes of `alpha`; say what can."""
    # A facet must not turn by more than MAX_SLOPE_CHANGE against its neighbour. Measured: half of that again moves
    # E_1 … E_3 by less than 0.0015.
    least = max(4.0, SLOPE_CHANGE_PER_TEXEL * alpha / MAX_SLOPE_CHANGE)
    texels = math.ceil(least)
    if not (math.isfinite(texels_per_correlation) and texels_per_correlation >= least):
        raise ValueError(
            f"Heightfield.gaussian(texels_per_correlation=...) must be at least {least:.3g} to resolve alpha = "
            f"{alpha:g}; got {texels_per_correlation}. Use texels_per_correlation={texels} with "
            f"size={MIN_CORRELATIONS * texels} or more."
        )
    needed = math.ceil(MIN_CORRELATIONS * texels_per_correlation)
    if size < needed:
        raise ValueError(
            f"Heightfield.gaussian(size=...) must be at least {needed} texels, {MIN_CORRELATIONS} correlation lengths "
            f"of {texels_per_correlation:g} texels; got {size}. Use size={needed} or more."
        )


def _correlated_noise(size: int, length: float | int, seed: int) -> np.ndarray:
    """Periodic Gaussian noise with autocorrelation ∝ exp(−r²/length²), length in texels (spectral synthesis)."""
    noise = np.random.Generator(np.random.Philox(seed)).standard_normal((size, size))
    kx = 2 * math.pi * np.fft.fftfreq(size)
    ky = 2 * math.pi * np.fft.rfftfreq(size)
    # The power spectrum of exp(−r²/l²) is ∝ exp(−k² l²/4); amplitudes are its square root.
    spectrum = np.fft.rfft2(noise)
    spectrum *= np.exp(-(kx**2) * length**2 / 8)[:, None]
    spectrum *= np.exp(-(ky**2) * length**2 / 8)[None, :]
    spectrum[0, 0] = 0
    return np.fft.irfft2(spectrum, s=(size, size))
