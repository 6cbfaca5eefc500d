"""The options of `torchms render`, free of heavy imports."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class RenderOptions:
    """Shade a mesh that has a rough surface under one light: direct light only, and the paths through glass.

    Example: torchms render sphere --bsdf "RoughConductor(GGX(0.3), Conductor.metal('Cu'))" --light constant --out a.png
    """

    scene: tyro.conf.Positional[str]
    """slab, sphere or plane, or a mesh file (.obj, .ply, .stl, .off, .glb)."""
    out: str
    """Where the picture goes: .png (tone-mapped) or .exr (linear)."""
    bsdf: str = 'RoughConductor(GGX(0.3), Conductor.metal("Au"), Bidirectional(Invariance(), max_order=8))'
    """The surface, as it is written in Python; torchms and torchms.fresnel have the names."""
    light: str = "directional"
    """directional, constant (the same from everywhere: a furnace), or a latitude-longitude map (.exr, .png)."""
    towards_light: tuple[float, float, float] = (-0.3, 1.0, 0.1)
    """Directional light only: the direction to it."""
    intensity: float = 1.0
    """Irradiance of a directional light on a surface that faces it; factor on the radiance of the others."""
    background: Literal["light", "black"] = "light"
    """What is seen where no surface is: the light itself, or nothing."""
    samples: int = 16
    """Camera rays a pixel; each takes one path of the BSDF for the light and one for the surface."""
    sampling: Literal["mis", "light", "bsdf"] = "mis"
    """How directions to the light are drawn: both ways weighted by the balance heuristic, or one of them only."""
    inner: int = 8
    """Glass only: segments of a path inside the body."""
    width: int = 256
    """Pixels across."""
    height: int = 256
    """Pixels down."""
    eye: tuple[float, float, float] | None = None
    """Where the camera is; each scene has a place of its own for it."""
    target: tuple[float, float, float] | None = None
    """What the camera looks at."""
    fov: float = 45.0
    """Angle that the picture's height covers [degrees]."""
    crease: float = 30.0
    """Mesh files only: normals are smoothed over edges that bend by less than this [degrees]."""
    exposure: float = 0.0
    """PNG only: stops by which it is brightened."""
    tone: Literal["srgb", "filmic"] = "srgb"
    """PNG only: clip at 1, or roll highlights off."""
    stderr: str | None = None
    """Also write the standard error of every pixel to this file (.exr, or .png with the same tone mapping)."""
    seed: int = 0
    """Seed of the random numbers; the picture depends on it, on the size and on the samples only."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite the files."""
