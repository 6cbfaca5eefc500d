"""What a BSDF is made of as the parts of a simulation, so that an explicit surface and a model can be compared in one call.

simulate(surfaces_of(bsdf.distribution), facets_of(bsdf), wi, n_rays=1e6), measure(bsdf, wi, n_paths=1_000_000)
"""

from torchms.bsdfs import BSDF, RoughConductor, RoughDielectric, RoughDiffuse
from torchms.distributions import Beckmann, MicrofacetDistribution
from torchms.fresnel import Dielectric
from torchms.microsurface.simulation.materials import DielectricFacets, DiffuseFacets, FacetMaterial, MirrorFacets
from torchms.microsurface.surfaces.recipe import GaussianSurfaces


def surfaces_of(
    distribution: MicrofacetDistribution, count: int = 8, size: int = 1024, texels_per_correlation: float | int = 16.0
) -> GaussianSurfaces:
    """The recipe for `count` explicit surfaces with this distribution of normals.

    Raises ValueError for another one than Beckmann: those of a Gaussian random surface are.
    """
    if not isinstance(distribution, Beckmann):
        raise ValueError(
            f"an explicit Gaussian surface has Beckmann's normals; got {type(distribution).__name__}. Use Beckmann(alpha) "
            "(--distribution beckmann), or a measured surface of your own (--surface)."
        )
    alpha, alpha_y = (float(a) for a in distribution.alphas)
    return GaussianSurfaces(alpha, alpha_y, count, size, texels_per_correlation)


def facets_of(bsdf: BSDF) -> FacetMaterial:
    """What the facets of `bsdf` do to light; its scattering does not matter. ValueError for a BSDF of another kind."""
    if isinstance(bsdf, RoughConductor):
        return MirrorFacets(bsdf.fresnel)
    if isinstance(bsdf, RoughDielectric) and isinstance(bsdf.fresnel, Dielectric):
        return DielectricFacets(float(bsdf.fresnel.eta))
    if isinstance(bsdf, RoughDiffuse):
        return DiffuseFacets(bsdf.reflectance.reshape(-1).tolist())
    raise ValueError(
        f"facets_of(bsdf=...) must be a rough conductor, dielectric with Dielectric(eta) or diffuse; got {bsdf!r}."
    )
