"""The options of each command, free of heavy imports so that `--help` answers at once."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from torchms.cli.surface import Count, Distribution, Scattering, SurfaceOptions


@dataclass(frozen=True, kw_only=True)
class EnergyOptions(SurfaceOptions):
    """Print how much energy leaves a rough surface after each bounce, per model.

    Example: torchms energy --material conductor --metal Au --alpha 0.5 --theta 0 0.5 1.0 1.5
    """

    theta: tuple[float, ...] = (0.0, 0.5, 1.0, 1.5)
    """Angles between the incident direction and the normal [rad]."""
    phi: float = 0.0
    """Azimuth of the incident direction [rad]."""
    models: tuple[Scattering, ...] = ("uncorrelated", "correlated", "invariance", "height-walk")
    """Models to compare; one that does not hold for the material is left out with the reason.

    With --bsdf its own model alone is shown, unless this option is given."""
    max_order: int = 10
    """Bounces to count."""
    samples: Count = "1e6"
    """Random walks per entry."""
    seed: int = 0
    """Seed of the random walks."""
    json: str | None = None
    """Also write the numbers to this file."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite the file."""


@dataclass(frozen=True, kw_only=True)
class ExplicitOptions(SurfaceOptions):
    """What `simulate` and `figures` share: the explicit surfaces and how they are lit."""

    distribution: Distribution = "beckmann"
    """Distribution of the microfacet normals: those of a Gaussian surface are Beckmann's."""
    phi: float = 0.0
    """Azimuth of incidence, in radians."""
    surfaces: int = 8
    """Independent surfaces; the standard errors are their spread."""
    size: int = 1024
    """Texels along each edge of a surface."""
    seed: int = 0
    """Seed of surfaces, light paths and random walks."""
    force: bool = False
    """Overwrite the output files if they exist."""


@dataclass(frozen=True, kw_only=True)
class SimulateOptions(ExplicitOptions):
    """Bounce light on the facets of an explicit microsurface and report what leaves after each bounce.

    Example: torchms simulate --material conductor --alpha 0.6 --theta 1.1 --rays 3e5 --json out.json
    """

    theta: float = 0.0
    """Angle of incidence from the macro-normal, in radians, in [0, pi/2)."""
    rays: Count = 1e6
    """Light paths in all, shared among the surfaces."""
    max_order: int = 16
    """Bounces that are told apart; what is still inside after them is reported as lost (below 1e-4 for 16)."""
    texels_per_correlation: float = 16.0
    """Texels in one correlation length."""
    surface: Path | None = None
    """A measured surface instead: a scan (.x3p, text), 16-bit PNG or TIFF, .npy, or a mesh (.ply, .obj, .stl, .off, .glb)."""
    spacing: float | None = None
    """Distance between the texels of --surface, unless its file says it."""
    height_scale: float | None = None
    """What the values of --surface are multiplied by to be in the unit of --spacing; asked for where they are 16-bit steps."""
    periodic: bool = False
    """Whether --surface tiles without a seam; otherwise it is mirrored."""
    interpolate_normals: bool = False
    """Scatter about normals interpolated between the vertices instead of the facets' own."""
    model: Scattering | Literal["own"] | None = None
    """A model to set beside the surface, with the difference in standard errors; "own" is that of --bsdf."""
    walks: Count = 1e6
    """Random walks of --model."""
    tracer: Literal["embree", "grid"] = "embree"
    """Embree on the triangle mesh, or a float64 walk over the heights (no Embree needed)."""
    threads: int | None = None
    """Threads of this process; all its cores if not given."""
    checkpoint: Path | None = None
    """Directory of finished shards; a run that was killed goes on from there."""
    json: Path | None = None
    """Where to write the result as JSON."""
    lobes: Path | None = None
    """Where to write the directional histograms as .npz (arrays mean and stderr)."""
    progress: bool = True
    """Progress bar, if standard error is a terminal."""


@dataclass(frozen=True, kw_only=True)
class FiguresOptions(ExplicitOptions):
    """Draw the lobes in the plane of incidence per bounce: explicit surface against the models.

    Example: torchms figures --material conductor --alpha 0.5 --out figures
    """

    theta: tuple[float, ...] = (0.0, 0.5, 1.0, 1.5)
    """Angles of incidence, in radians; a column each."""
    rays: Count = 2e6
    """Simulated light paths an angle."""
    walks: Count = 5e5
    """Random walks a model and angle."""
    max_order: int = 10
    """Bounces that are told apart."""
    tracer: Literal["embree", "grid"] = "grid"
    """Embree, or the float64 walk over the heights, whose surfaces need no building."""
    out: Path = Path("figures")
    """Directory for the PNG, the SVG and the JSON."""


@dataclass(frozen=True)
class RenderOptions(SurfaceOptions):
    """Shade a mesh that has a rough surface under one light: direct light only, and the paths through glass.

    Example: torchms render sphere --bsdf "RoughConductor(GGX(0.3), Conductor.metal('Cu'))" --light constant --out a.png
    """

    scene: tyro.conf.Positional[str]
    """slab, sphere or plane, or a mesh file (.obj, .ply, .stl, .off, .glb)."""
    out: str
    """Where the picture goes: .png (tone-mapped) or .exr (linear)."""
    base_color: tuple[float, float, float] | None = None
    """A surface of glTF's metallic-roughness material instead of the options above: its base colour, linear, in [0, 1]."""
    metallic: float | None = None
    """With --base-color: how much of a metal it is, in [0, 1]; 0 if it is not given."""
    roughness: float | None = None
    """With --base-color: glTF's roughness, the root of alpha, in [0, 1]; 0.5 if it is not given."""
    scattering: Scattering | None = None
    """Model of the bounces. Not given: that of --bsdf, or distilled where it is the surface's default and --max-order is not
    given; elsewhere bidirectional-invariance, height-walk for a dielectric."""
    max_order: int = 8
    """Bounces to count."""
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


@dataclass(frozen=True)
class ExportOptions(SurfaceOptions):
    """Write one evaluator of a rough surface as a self-contained ONNX file.

    Example: torchms export copper.onnx --material conductor --metal Cu --parameters alpha alpha_y --check
    """

    path: tyro.conf.Positional[str]
    """The file to write."""
    scattering: Scattering | None = None
    """Model of the bounces. Not given: that of --bsdf, or distilled where it is the surface's default and --max-order is not
    given; elsewhere invariance, height-walk for a dielectric."""
    max_order: int = 4
    """Bounces to count. Writing a file takes about 5 s a bounce, for bidirectional with the square of it."""
    what: Literal["forward", "orders", "sample", "pdf"] = "forward"
    """The value, the value of each order, a direction with its density, or that density."""
    parameters: tuple[str, ...] = ()
    """Parameters that become inputs of the file, a value each element: alpha, alpha_y, gamma, eta, k, albedo."""
    uniforms: Literal["input", "sobol", "seed"] = "input"
    """Random numbers: an input u, a Sobol set that is baked in, or an input of one seed an element."""
    n_paths: int = 1
    """Paths whose mean is taken (for sample: directions an element)."""
    double: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Write a float64 file."""
    check: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Compare the file with eager over a grid of hard cases first, and do not write it if it misses a bound."""
    rows: Count = 100_000
    """Rows of that grid."""
    json: str | None = None
    """Also write the comparison to this file."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite files."""
