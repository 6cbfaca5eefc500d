"""The options of the command line, free of heavy imports so that `--help` answers at once."""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol, runtime_checkable

import tyro

Material = Literal["conductor", "dielectric", "diffuse"]
Model = Literal["uncorrelated", "correlated", "invariance", "height-walk", "single-bounce", "kulla-conty", "turquin"]


@runtime_checkable
class SurfaceOptions(Protocol):
    """The options that say what a surface is, of whatever command."""

    @property
    def material(self) -> Material: ...
    @property
    def metal(self) -> str | None: ...
    @property
    def distribution(self) -> str: ...
    @property
    def alpha(self) -> str: ...
    @property
    def gamma(self) -> float | None: ...
    @property
    def eta(self) -> float: ...
    @property
    def albedo(self) -> float: ...


@dataclass(frozen=True)
class EnergyOptions:
    """Print how much energy leaves a rough surface after each bounce, per model.

    Example: torchms energy --material conductor --metal Au --alpha 0.5 --theta 0 0.5 1.0 1.5
    """

    material: Material = "conductor"
    """What the facets are made of."""
    metal: str | None = None
    """Conductor only: a measured metal such as Au, Ag, Cu; without it the facets reflect everything (F = 1)."""
    distribution: Literal["ggx", "beckmann", "gtr"] = "ggx"
    """Distribution of the microfacet normals."""
    alpha: str = "0.5"
    """Roughness: one number, or alpha_x,alpha_y."""
    gamma: float | None = None
    """GTR only: how short the tails are, in (0, 10]; 2, which is GGX, if it is not given."""
    eta: float = 1.5
    """Dielectric only: n_inside / n_outside."""
    albedo: float = 1.0
    """Diffuse only: albedo of a facet."""
    theta: tuple[float, ...] = (0.0, 0.5, 1.0, 1.5)
    """Angles between the incident direction and the normal [rad]."""
    phi: float = 0.0
    """Azimuth of the incident direction [rad]."""
    models: tuple[Model, ...] = ("uncorrelated", "correlated", "invariance", "height-walk")
    """Models to compare; one that does not hold for the material is left out with the reason."""
    max_order: int = 10
    """Bounces to count."""
    samples: str = "1e6"
    """Random walks per entry."""
    seed: int = 0
    """Seed of the random walks."""
    json: str | None = None
    """Also write the numbers to this file."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite the file."""
