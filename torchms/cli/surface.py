"""How a command line describes a surface, the same in every command; free of heavy imports, so that `--help` is instant."""

from dataclasses import dataclass
from typing import Literal

Material = Literal["conductor", "dielectric", "diffuse"]
Distribution = Literal["ggx", "beckmann", "gtr"]
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
    "distilled",
]
"""The names of `torchms.bsdfs.named`, written once more for the parser; a test compares them."""

Count = str | int | float
"""A whole number, which may be written as 1e6: `torchms.cli.arguments.parse_count`."""


@dataclass(frozen=True, kw_only=True)
class SurfaceOptions:
    """What a surface is: an expression, or short options for the usual ones."""

    bsdf: str | None = None
    """The surface as it is written in Python, "RoughConductor(GGX(0.3), Ideal())", instead of the options below."""
    material: Material = "conductor"
    """What the facets are made of."""
    metal: str | None = None
    """Conductor only: a measured metal such as Au, Ag, Cu; without it the facets reflect everything (F = 1)."""
    distribution: Distribution = "ggx"
    """Distribution of the microfacet normals."""
    alpha: str | float = "0.5"
    """Roughness: one number, or alpha_x,alpha_y."""
    alpha_y: float | None = None
    """Roughness along y, if it is not in --alpha."""
    gamma: float | None = None
    """GTR only: how short the tails are, in (0, 10]; 2, which is GGX, if it is not given."""
    eta: float | None = None
    """Dielectric only: n_inside / n_outside; 1.5 if it is not given."""
    albedo: float | None = None
    """Diffuse only: albedo of a facet; 1 if it is not given."""

    @property
    def index(self) -> float:
        """--eta, or the usual one."""
        return 1.5 if self.eta is None else self.eta

    @property
    def facet_albedo(self) -> float:
        """--albedo, or the usual one."""
        return 1.0 if self.albedo is None else self.albedo
