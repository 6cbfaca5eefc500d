"""Explicit microsurfaces and the light that bounces on them: the simulator that the models are held against.

    from torchms.microsurface import GaussianSurfaces, MirrorFacets, simulate

    tally = simulate(GaussianSurfaces(0.5, count=8), MirrorFacets(), (0.0, 0.0, 1.0), n_rays=1_000_000, seed=1)

Needs the extra `microsurface` (trimesh, embreex, numba), which is imported on first use.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torchms.microsurface.rays.grid_walk import GridTracer
    from torchms.microsurface.rays.tracer import EmbreeTracer, Tracer
    from torchms.microsurface.simulation.materials import DielectricFacets, DiffuseFacets, FacetMaterial, MirrorFacets
    from torchms.microsurface.simulation.parts import facets_of, surfaces_of
    from torchms.microsurface.simulation.plan import Plan
    from torchms.microsurface.simulation.simulate import simulate
    from torchms.microsurface.surfaces.heightfield import Heightfield
    from torchms.microsurface.surfaces.recipe import GaussianSurfaces

__all__ = [
    "DielectricFacets",
    "DiffuseFacets",
    "EmbreeTracer",
    "FacetMaterial",
    "GaussianSurfaces",
    "GridTracer",
    "Heightfield",
    "MirrorFacets",
    "Plan",
    "Tracer",
    "facets_of",
    "simulate",
    "surfaces_of",
]

_HOME = {
    "EmbreeTracer": "rays.tracer",
    "FacetMaterial": "simulation.materials",
    "GaussianSurfaces": "surfaces.recipe",
    "GridTracer": "rays.grid_walk",
    "Heightfield": "surfaces.heightfield",
    "DielectricFacets": "simulation.materials",
    "DiffuseFacets": "simulation.materials",
    "MirrorFacets": "simulation.materials",
    "Plan": "simulation.plan",
    "Tracer": "rays.tracer",
    "facets_of": "simulation.parts",
    "simulate": "simulation.simulate",
    "surfaces_of": "simulation.parts",
}


def __getattr__(name: str) -> Any:
    # Lazy, so that the command line answers --help without loading torch.
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module 'torchms.microsurface' has no attribute {name!r}")
    value = getattr(import_module(f"torchms.microsurface.{_HOME[name]}"), name)
    globals()[name] = value
    return value
