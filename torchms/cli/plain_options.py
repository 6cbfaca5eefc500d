"""Options of the commands that take no description of a surface."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class LabOptions:
    """Show the lobe lab, a page with every bounce of a surface: serve what `make lab` built, and open a browser on it.

    Example: torchms lab --port 8000
    """

    folder: Path | None = None
    """The built page; build/lab of the checkout if it is not given."""
    port: int = 0
    """Port on 127.0.0.1; 0 takes any that is free."""
    browser: bool = True
    """Open the page in a browser."""


@dataclass(frozen=True, kw_only=True)
class LutOptions:
    """Write the table in which renderers look up what a rough metal returns of the light from everywhere.

    Example: torchms lut --out bsdf_256_256.bin
    """

    out: Path
    """The file to write: float32, row after row of roughness."""
    bounces: Literal["one", "all"] = "one"
    """one: scale and bias of F0, the layout of nvdiffrec's bsdf_256_256.bin. all: two planes of four, energies by order."""
    size: int = 256
    """Rows and columns."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite the file."""


@dataclass(frozen=True, kw_only=True)
class FitMeasuredOptions:
    """Fit a metal-roughness material to a measured surface, with all bounces and with one.

    Example: torchms fit-measured paper_white_rgb.bsdf --out paper.png
    """

    file: tyro.conf.Positional[Path]
    """An isotropic _rgb.bsdf of rgl.epfl.ch/materials."""
    diffuse: Literal["rough", "lambert"] = "rough"
    """The base below the facets."""
    metallic: float | None = None
    """A number that metallic is held at; it is fitted if it is not given."""
    ior: float | None = None
    """A number that the index of the dielectric is held at."""
    out: Path | None = None
    """Picture (.png): spheres and lobes, measured and fitted."""
    json: Path | None = None
    """Also write the numbers to this file."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite the files."""


@dataclass(frozen=True, kw_only=True)
class DistilOptions:
    """Learn the whole lobe of a measured surface from ray-traced light on it: `Distilled("scan.npz")`.

    A stopped run goes on where it was if it is called again; under torchrun the light is traced by all processes.
    Example: torchms distil --surface scan.npy --spacing 0.5 --height-scale 0.001 --out scan.npz
    """

    surface: Path
    """Heights: .npy, a 16-bit or float .png or .tif, a scan (.x3p, .xyz, …), or a mesh."""
    out: Path
    """The file to write (.npz)."""
    spacing: tuple[float, ...] | None = None
    """Distance between neighbouring heights, or that along x and that along y; asked for where the file does not say it."""
    height_scale: float | None = None
    """Length of one step of the map's values, in the same unit; asked for with pictures and .npy."""
    material: Literal["conductor", "diffuse", "dielectric"] = "conductor"
    """What its facets are of: metal with any Fresnel term, diffuse with any albedo, or glass with --eta."""
    eta: float | None = None
    """n inside / n outside of glass, the material beneath the heights; in [1/3, 3]."""
    periodic: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """The map repeats without a seam; otherwise it is mirrored."""
    coarse: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Take the facets as they are, though they do not resolve the slopes."""
    work: Path = Path("build/distil/scan")
    """Folder of blocks of light and of checkpoints."""
    paths: str | int | float = "8e6"
    """Light paths to learn from."""
    steps: int = 2000
    """Adam's steps on the likelihood."""
    held_out: str | int | float = "2.5e5"
    """Light paths of each of 13 directions of incidence to be compared with."""
    seed: int = 1
    """Seed of everything."""
    threads: int | None = None
    """Threads of the simulation; one a core if it is not given."""
    json: Path | None = None
    """Also write the report to this file."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite the files."""
