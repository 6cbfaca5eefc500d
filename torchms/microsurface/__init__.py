"""Explicit microsurfaces and the light that bounces on them: the simulator that the models are held against.

    from torchms.microsurface import GaussianSurfaces, MirrorFacets, simulate

    tally = simulate(GaussianSurfaces(0.5, count=8), MirrorFacets(), (0.0, 0.0, 1.0), n_rays=1_000_000, seed=1)

Needs the extra `microsurface` (trimesh, embreex, numba), which is imported on first use.
"""

from typing import TYPE_CHECKING

from torchms.lazy import lazily

if TYPE_CHECKING:
    from torchms.microsurface.rays.grid_walk import GridTracer as GridTracer
    from torchms.microsurface.rays.tracer import EmbreeTracer as EmbreeTracer
    from torchms.microsurface.rays.tracer import Tracer as Tracer
    from torchms.microsurface.simulation.materials import DielectricFacets as DielectricFacets
    from torchms.microsurface.simulation.materials import DiffuseFacets as DiffuseFacets
    from torchms.microsurface.simulation.materials import FacetMaterial as FacetMaterial
    from torchms.microsurface.simulation.materials import MirrorFacets as MirrorFacets
    from torchms.microsurface.simulation.parts import facets_of as facets_of
    from torchms.microsurface.simulation.parts import surfaces_of as surfaces_of
    from torchms.microsurface.simulation.plan import Plan as Plan
    from torchms.microsurface.simulation.simulate import simulate as simulate
    from torchms.microsurface.surfaces.heightfield import Heightfield as Heightfield
    from torchms.microsurface.surfaces.holes import filled as filled
    from torchms.microsurface.surfaces.recipe import GaussianSurfaces as GaussianSurfaces

_HOME = {
    "DielectricFacets": "simulation.materials",
    "DiffuseFacets": "simulation.materials",
    "EmbreeTracer": "rays.tracer",
    "FacetMaterial": "simulation.materials",
    "GaussianSurfaces": "surfaces.recipe",
    "GridTracer": "rays.grid_walk",
    "Heightfield": "surfaces.heightfield",
    "MirrorFacets": "simulation.materials",
    "Plan": "simulation.plan",
    "Tracer": "rays.tracer",
    "facets_of": "simulation.parts",
    "filled": "surfaces.holes",
    "simulate": "simulation.simulate",
    "surfaces_of": "simulation.parts",
}

__getattr__ = lazily(__name__, _HOME)
