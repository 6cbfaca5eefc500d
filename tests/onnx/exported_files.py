"""The files that the tests of exported evaluators share."""

from collections.abc import Callable

from torchms import (
    BSDF,
    GGX,
    Beckmann,
    Correlated,
    HeightWalk,
    RoughConductor,
    RoughDielectric,
    RoughDiffuse,
    SingleBounce,
    Unidirectional,
)
from torchms.fresnel import Conductor, Dielectric, Ideal
from torchms.onnx.exporter import checked
from torchms.onnx.graph import Graph


def _conductor(channels: int) -> BSDF:
    eta, k = [0.2 + 0.05 * c for c in range(channels)], [3.9 - 0.1 * c for c in range(channels)]
    return RoughConductor(GGX(0.3, 0.7), Conductor(eta, k), SingleBounce())


FILES: dict[str, tuple[Callable[[], BSDF], dict]] = {
    "conductor-1": (lambda: _conductor(1), {"parameters": ("alpha", "alpha_y")}),
    "conductor-3": (lambda: _conductor(3), {"parameters": ("alpha", "alpha_y", "eta", "k")}),
    "conductor-31": (lambda: _conductor(31), {"parameters": ("k",)}),
    "conductor-double": (lambda: _conductor(3).double(), {"parameters": ("alpha", "k")}),
    "conductor-seed": (
        lambda: RoughConductor(GGX(0.3), Conductor([0.2, 0.9], [3.0, 2.5]), Unidirectional(Correlated(), 2)),
        {"uniforms": "seed", "n_paths": 3, "parameters": ("alpha", "alpha_y")},
    ),
    "glass-orders": (
        lambda: RoughDielectric(GGX(0.4, 0.6), Dielectric(1.5), HeightWalk(2)),
        {"what": "orders", "n_paths": None, "parameters": ("eta",)},
    ),
    "diffuse-sobol": (
        lambda: RoughDiffuse(GGX(0.5), [0.3, 0.9], SingleBounce()),
        {"uniforms": "sobol", "n_paths": 8, "parameters": ("alpha", "albedo")},
    ),
    "conductor-sample": (lambda: _conductor(3), {"what": "sample", "n_paths": 2, "parameters": ("alpha",)}),
    "beckmann-pdf": (
        lambda: RoughConductor(Beckmann(0.3, 0.7), Ideal(), SingleBounce()),
        {"what": "pdf", "parameters": ("alpha",)},
    ),
}
"""Small files that the default tests share; the whole matrix is `python -m export`."""


def graph_of(name: str) -> Graph:
    """What was exported as `name`."""
    make, arguments = FILES[name]
    given = {"what": "forward", "parameters": (), "uniforms": "input", "n_paths": 1} | arguments
    return checked(make(), **given)
