"""Materials, distributions and scatterings by the names that command lines give them; a new class is one line here."""

from collections.abc import Callable

from torchms.approximations import Distilled, KullaConty, Turquin
from torchms.bsdfs.base import BSDF
from torchms.bsdfs.rough_conductor import RoughConductor
from torchms.bsdfs.rough_dielectric import RoughDielectric
from torchms.bsdfs.rough_diffuse import RoughDiffuse
from torchms.distributions import GGX, GTR, Beckmann, MicrofacetDistribution
from torchms.estimators import Bidirectional, HeightWalk, Scattering, SingleBounce, Unidirectional
from torchms.paths.segments import Correlated, Invariance, Uncorrelated

MATERIALS: dict[str, type[BSDF]] = {
    "conductor": RoughConductor,
    "dielectric": RoughDielectric,
    "diffuse": RoughDiffuse,
}
DISTRIBUTIONS: dict[str, Callable[..., MicrofacetDistribution]] = {"ggx": GGX, "beckmann": Beckmann, "gtr": GTR}
SCATTERINGS: dict[str, Callable[[int], Scattering]] = {
    "single-bounce": lambda K: SingleBounce(),
    "uncorrelated": lambda K: Unidirectional(Uncorrelated(), K),
    "correlated": lambda K: Unidirectional(Correlated(), K),
    "invariance": lambda K: Unidirectional(Invariance(), K),
    "height-walk": HeightWalk,
    "bidirectional-uncorrelated": lambda K: Bidirectional(Uncorrelated(), K),
    "bidirectional-correlated": lambda K: Bidirectional(Correlated(), K),
    "bidirectional-invariance": lambda K: Bidirectional(Invariance(), K),
    "kulla-conty": lambda K: KullaConty(),
    "turquin": lambda K: Turquin(),
    "distilled": lambda K: Distilled(),
}
"""What stands in the scattering slot, for so many bounces."""


def maker_of(material: str) -> Callable[..., BSDF]:
    """What makes a surface of that material: a function of the distribution, of what the facets do, and of a scattering."""
    return MATERIALS[material]


def material_of(bsdf: BSDF) -> str:
    """The name of its material; ValueError if it has none."""
    for name, kind in MATERIALS.items():
        if isinstance(bsdf, kind):
            return name
    raise ValueError(f"{type(bsdf).__name__} has no name here; known: {', '.join(MATERIALS)}.")


def with_scattering(bsdf: BSDF, scattering: Scattering) -> BSDF:
    """The same surface with another model in its scattering slot; ValueError where that does not hold for it."""
    if isinstance(bsdf, RoughConductor):
        return RoughConductor(bsdf.distribution, bsdf.fresnel, scattering)
    if isinstance(bsdf, RoughDielectric):
        return RoughDielectric(bsdf.distribution, bsdf.fresnel, scattering, bsdf.mode)
    if isinstance(bsdf, RoughDiffuse):
        return RoughDiffuse(bsdf.distribution, bsdf.reflectance, scattering)
    raise ValueError(f"the scattering of a {type(bsdf).__name__} cannot be exchanged here.")
