"""The options of `torchms export`, free of heavy imports so that `--help` answers at once."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

Scattering = Literal[
    "single-bounce",
    "uncorrelated",
    "correlated",
    "invariance",
    "height-walk",
    "bidirectional-uncorrelated",
    "bidirectional-correlated",
    "bidirectional-invariance",
    "kulla-conty",
    "turquin",
]


@dataclass(frozen=True)
class ExportOptions:
    """Write one evaluator of a rough surface as a self-contained ONNX file.

    Example: torchms export copper.onnx --material conductor --metal Cu --parameters alpha alpha_y --check
    """

    path: tyro.conf.Positional[str]
    """The file to write."""
    material: Literal["conductor", "dielectric", "diffuse"] = "conductor"
    """What the facets are made of."""
    metal: str | None = None
    """Conductor only: a measured metal such as Au, Ag, Cu; without it the facets reflect everything (F = 1)."""
    distribution: Literal["ggx", "beckmann", "gtr"] = "ggx"
    """Distribution of the microfacet normals."""
    alpha: str = "0.5"
    """Roughness: one number, or alpha_x,alpha_y; the value is baked in unless it is among the parameters."""
    gamma: float | None = None
    """GTR only: how short the tails are, in (0, 10]; 2, which is GGX, if it is not given."""
    eta: float = 1.5
    """Dielectric only: n_inside / n_outside."""
    albedo: float = 1.0
    """Diffuse only: albedo of a facet."""
    scattering: Scattering | None = None
    """Model of the bounces; invariance if it is not given, height-walk for a dielectric."""
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
    rows: int = 100_000
    """Rows of that grid."""
    json: str | None = None
    """Also write the comparison to this file."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite files."""
