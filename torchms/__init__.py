"""Multiple-bounce microfacet BSDFs in PyTorch.

Names are loaded when they are first used, so that `torchms --help` need not wait for torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from torchms.version import __version__

if TYPE_CHECKING:
    from torchms import approximations, fresnel, lobes, measured, microsurface, onnx, render, shading, testing
    from torchms.approximations import Distilled, KullaConty, Turquin
    from torchms.bsdfs import BSDF, RoughConductor, RoughDielectric, RoughDiffuse
    from torchms.bsdfs.compile import compile
    from torchms.citations import cite
    from torchms.distributions import GGX, GTR, Beckmann, MicrofacetDistribution
    from torchms.estimators import Bidirectional, HeightWalk, Scattering, SingleBounce, Unidirectional
    from torchms.evaluation.arguments import set_validation
    from torchms.parameters.constrain import constrain
    from torchms.paths.segments import Correlated, Invariance, Segment, Uncorrelated
    from torchms.sampling.stream import Stream
    from torchms.shading import alpha, alphas

_HOME = {
    "BSDF": "bsdfs",
    "RoughConductor": "bsdfs",
    "RoughDielectric": "bsdfs",
    "RoughDiffuse": "bsdfs",
    "Beckmann": "distributions",
    "GGX": "distributions",
    "GTR": "distributions",
    "MicrofacetDistribution": "distributions",
    "Bidirectional": "estimators",
    "Distilled": "approximations",
    "HeightWalk": "estimators",
    "KullaConty": "approximations",
    "Scattering": "estimators",
    "SingleBounce": "estimators",
    "Stream": "sampling.stream",
    "Unidirectional": "estimators",
    "Correlated": "paths.segments",
    "Invariance": "paths.segments",
    "Segment": "paths.segments",
    "Turquin": "approximations",
    "Uncorrelated": "paths.segments",
    "alpha": "shading",
    "alphas": "shading",
    "cite": "citations",
    "compile": "bsdfs.compile",
    "constrain": "parameters.constrain",
    "set_validation": "evaluation.arguments",
}
_MODULES = ("approximations", "fresnel", "lobes", "measured", "microsurface", "onnx", "render", "shading", "testing")

__all__ = [
    "BSDF",
    "GGX",
    "GTR",
    "Beckmann",
    "Bidirectional",
    "Correlated",
    "Distilled",
    "HeightWalk",
    "Invariance",
    "KullaConty",
    "MicrofacetDistribution",
    "RoughConductor",
    "RoughDielectric",
    "RoughDiffuse",
    "Scattering",
    "Segment",
    "SingleBounce",
    "Stream",
    "Turquin",
    "Uncorrelated",
    "Unidirectional",
    "__version__",
    "alpha",
    "alphas",
    "approximations",
    "cite",
    "compile",
    "constrain",
    "fresnel",
    "lobes",
    "measured",
    "microsurface",
    "onnx",
    "render",
    "set_validation",
    "shading",
    "testing",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"torchms.{name}")
    if name in _HOME:
        value = getattr(import_module(f"torchms.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'torchms' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
