"""Simulation and models side by side: the same material, roughness, direction and bins."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchms.bsdfs import BSDF
from torchms.bsdfs.named import MATERIALS, SCATTERINGS, maker_of, with_scattering
from torchms.distributions import Beckmann
from torchms.fresnel import Dielectric, Ideal
from torchms.lobes import Tally, measure
from torchms.maths.frame import direction
from torchms.microsurface.rays.tracer import Tracer
from torchms.microsurface.simulation.materials import DielectricFacets, DiffuseFacets, FacetMaterial, MirrorFacets
from torchms.microsurface.simulation.parts import facets_of
from torchms.microsurface.simulation.simulate import simulate
from torchms.microsurface.surfaces.recipe import GaussianSurfaces

SIMULATION = "simulation"
MODELS = {
    "height walk": "height-walk",
    "uncorrelated": "uncorrelated",
    "correlated": "correlated",
    "invariance": "invariance",
}
"""What a figure calls a model, and its name on the command line."""


@dataclass(frozen=True)
class Case:
    """One panel of comparison: conductor with F = 1, dielectric with `eta`, or diffuse with albedo 1, Beckmann.

    bsdf: a surface with facets of its own instead, whose material, α and distribution the other fields repeat.
    """

    material: str
    alpha: tuple[float, float]
    theta: float
    phi: float = 0.0
    eta: float = 1.5
    max_order: int = 10
    bsdf: BSDF | None = None

    def __post_init__(self) -> None:
        if self.material not in MATERIALS:
            raise ValueError(f"Case(material=...) must be one of {', '.join(MATERIALS)}; got {self.material!r}.")

    @property
    def wi(self) -> Tensor:
        """Direction of incidence (3,)."""
        return direction(self.theta, self.phi)

    @property
    def facets(self) -> FacetMaterial:
        """What the simulated facets are."""
        if self.bsdf is not None:
            return facets_of(self.bsdf)
        named = {"conductor": MirrorFacets(), "dielectric": DielectricFacets(self.eta), "diffuse": DiffuseFacets()}
        return named[self.material]

    @property
    def models(self) -> tuple[str, ...]:
        """Names of the models that hold for this material: invariance knows one side of the surface only."""
        return tuple(name for name in MODELS if not (name == "invariance" and self.material == "dielectric"))

    def modelled_by(self, model: str) -> BSDF:
        """The surface with the model of that name."""
        bsdf = self.bsdf
        if bsdf is None:
            facet = {"conductor": Ideal(), "dielectric": Dielectric(self.eta), "diffuse": 1.0}[self.material]
            bsdf = maker_of(self.material)(Beckmann(*self.alpha), facet)
        return with_scattering(bsdf, SCATTERINGS[MODELS[model]](self.max_order))

    def simulated(self, surfaces: int, size: int, rays: float | int, seed: int, tracer: Tracer) -> Tally:
        """The explicit surface's result, on `surfaces` independent ones of `size` texels."""
        recipe = GaussianSurfaces(*self.alpha, count=surfaces, size=size)
        return simulate(recipe, self.facets, self.wi, n_rays=rays, max_order=self.max_order, seed=seed, tracer=tracer)

    def modelled(self, model: str, walks: int, seed: int, lobes: bool = True) -> Tally:
        """A model's result, by its own random walk."""
        bins = (64, 64) if lobes else None
        wi = self.wi.to(torch.get_default_dtype())
        return measure(self.modelled_by(model), wi, n_paths=walks, seed=seed, bins=bins, progress=False)


def energies(tally: Tally) -> dict[str, Any]:
    """Energies per order of the first channel, JSON-serialisable."""
    names = ("reflected", "reflected_stderr", "transmitted", "transmitted_stderr")
    return {name: getattr(tally, name)[:, 0].tolist() for name in names} | {
        "total": tally.total[0].item(),
        "remaining": tally.remaining[0].item(),
        "n": tally.n,
    }


def gap(tally: Tally, truth: Tally) -> Tensor:
    """(2, K) difference of the energies, reflected and transmitted."""
    return torch.stack([(tally.reflected - truth.reflected)[:, 0], (tally.transmitted - truth.transmitted)[:, 0]])


def plane_of_incidence(tally: Tally, phi: float, half_width: int = 2) -> tuple[Tensor, Tensor, Tensor]:
    """Angle in the plane of incidence [rad], f · |cos θ_o| and its standard error (5, n): k = 1, 2, 3, ≥ 4 and all.

    The angle runs over the whole circle, 0 at the macro-normal, positive on the far side, where a mirror sends light;
    a value is the mean of the 2 · `half_width` azimuth bins that are nearest to the plane.
    """
    lobes = tally.lobes
    assert lobes is not None
    n_cos, n_phi = lobes.mean.shape[1:3]
    mean, error = lobes.mean[..., 0], lobes.stderr[..., 0]
    tail = (mean[3] - mean[:3].sum(0)).clamp_min(0)
    # What is left of k ≥ 4 is so little that counting dominates its error: n · bin · value paths in a bin.
    tail_error = torch.sqrt(tail / (tally.n * lobes.bin_sr))
    mean = torch.cat([mean[:3], tail[None], mean[3:]])
    error = torch.cat([error[:3], tail_error[None], error[3:]])
    cosine = (torch.arange(n_cos, dtype=torch.float64) + 0.5) * 2 / n_cos - 1
    theta = torch.arccos(cosine)
    sides = []
    for azimuth, sign in ((phi, -1.0), (phi + math.pi, 1.0)):
        nearest = round(azimuth / (2 * math.pi) * n_phi)
        columns = torch.arange(nearest - half_width, nearest + half_width) % n_phi
        value = mean[:, :, columns].mean(-1)
        spread = torch.sqrt((error[:, :, columns] ** 2).sum(-1)) / (2 * half_width)
        sides.append((sign * theta, value, spread))
    angle = torch.cat([sides[0][0], sides[1][0]])
    order = torch.argsort(angle)
    return angle[order], torch.cat([s[1] for s in sides], 1)[:, order], torch.cat([s[2] for s in sides], 1)[:, order]
