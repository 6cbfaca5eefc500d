"""Explicit microsurfaces and the light that bounces on them: the simulator that the models are held against.

    from torchms.microsurface import GaussianSurfaces, Mirror, simulate

    tally = simulate(GaussianSurfaces(0.5, count=8), Mirror(), (0.0, 0.0, 1.0), n_rays=1_000_000, seed=1)

Needs the extra `microsurface` (trimesh, embreex, numba), which is imported on first use.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torchms.microsurface.grid_walk import GridTracer
    from torchms.microsurface.heightfield import GaussianSurfaces, Heightfield
    from torchms.microsurface.materials import FacetMaterial, Lambertian, Mirror, Refractive
    from torchms.microsurface.simulation import simulate
    from torchms.microsurface.tracer import EmbreeTracer, Tracer

__all__ = [
    "EmbreeTracer",
    "FacetMaterial",
    "GaussianSurfaces",
    "GridTracer",
    "Heightfield",
    "Lambertian",
    "Mirror",
    "Refractive",
    "Tracer",
    "simulate",
]

_HOME = {
    "EmbreeTracer": "tracer",
    "FacetMaterial": "materials",
    "GaussianSurfaces": "heightfield",
    "GridTracer": "grid_walk",
    "Heightfield": "heightfield",
    "Lambertian": "materials",
    "Mirror": "materials",
    "Refractive": "materials",
    "Tracer": "tracer",
    "simulate": "simulation",
}


def __getattr__(name: str) -> Any:
    # Lazy, so that the command line answers --help without loading torch.
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module 'torchms.microsurface' has no attribute {name!r}")
    value = getattr(import_module(f"torchms.microsurface.{_HOME[name]}"), name)
    globals()[name] = value
    return value
