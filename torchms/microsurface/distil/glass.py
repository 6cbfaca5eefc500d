"""What light does on explicit surfaces of glass beyond Smith's theory: corrections of both that is reflected and transmitted.

All rows are seen from the side that light comes from: wi above, what is transmitted below, and the relative index of that side.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

from torchms.approximations.distil import glass_rows
from torchms.approximations.distil.glass_fit import inputs_of
from torchms.approximations.distil.glass_rows import Surfaces
from torchms.approximations.distilled import packaged
from torchms.approximations.glass_features import Features
from torchms.approximations.glass_lobes import GlassLobes
from torchms.approximations.glass_surface_lobes import SHARES, of_glass_smith
from torchms.distributions.base import MicrofacetDistribution
from torchms.estimators import SingleBounce
from torchms.fresnel import Dielectric
from torchms.maths.frame import Vec3, split
from torchms.microsurface.distil import fit
from torchms.microsurface.distil.light import Light
from torchms.microsurface.distil.networks import Folded
from torchms.paths.refractive import Refractive
from torchms.sampling.uniforms import generator_for

CHUNK = 16384
KIND = "Beckmann"
MORE = 4
SCALES = (0.5, 2.0)
"""Range of what few points of a direction may be scaled by."""


@cache
def smiths() -> GlassLobes:
    """All bounces between Beckmann facets of glass."""
    return GlassLobes(*(packaged(KIND, facet) for facet in ("reflected", "transmitted")))


def base() -> tuple[fit.Folded, ...]:
    """Weights of Smith's lobes."""
    return of_glass_smith(*(packaged(KIND, facet) for facet in ("reflected", "transmitted")))


@torch.no_grad()
def smith_glass(where: Surfaces, wo: Tensor, first: MicrofacetDistribution | None = None) -> Tensor:
    """|f cos θ_o| [1/sr] (n, ORDERS); that of more than one bounce is shared out as `GlassSurfaceLobes` does.

    first: whose facets the only bounce of a path meets, if they are not Beckmann's.
    """
    single, parts = SingleBounce(), []
    for some in torch.arange(len(wo)).split(CHUNK):
        here = where.part(some)
        wi, out = (Vec3(*(x[None] for x in split(w))) for w in (here.wi, wo[some]))
        facets, fresnel = here.distribution(KIND), Dielectric(here.eta)
        (once,) = single.evaluate(Refractive(facets if first is None else first, fresnel), wi, out, ())
        rest = smiths().rest(Refractive(facets, fresnel), wi, out)
        parts.append(torch.stack([once[0, 0], *(share * rest[0] for share in SHARES)], -1))
    return torch.cat(parts)


def learned(
    light: Light,
    features: Features,
    first: MicrofacetDistribution | None,
    sizes: tuple[Sequence[int], Sequence[int]],
    steps: int,
    seed: int,
    folder: Path,
) -> tuple[tuple[Folded, Folded], tuple[Folded, Folded]]:
    """Networks of the pair and of each direction, for light that is reflected and for light that is transmitted."""
    assert light.eta is not None
    where = Surfaces(light.where.ax, light.where.ay, light.eta, light.where.wi)
    up = light.rows.wo[:, 2] > 0

    def one(above: bool) -> tuple[Folded, Folded]:
        some = light.part(up == above)
        of_each = torch.arange(len(where.ax)).repeat_interleave(some.first.diff())
        inputs, _ = inputs_of(KIND, where.part(of_each), some.rows.wo, above, features=features)
        wo, smith = points(where, above, first, seed + 5 + above)
        there, _ = inputs_of(KIND, where.repeated(fit.POINTS), wo, above, features=features)
        name = "reflected" if above else "transmitted"
        model, vector, _ = fit.correction(inputs, some, (there, smith), sizes, steps, seed, folder, name)
        return model.folded(vector)

    return one(True), one(False)


def points(where: Surfaces, above: bool, first: MicrofacetDistribution | None, seed: int) -> tuple[Tensor, Tensor]:
    """fit.POINTS directions out of each on one side (n, 3), and Smith's λ_k there times their shares (n, ORDERS).

    The sums over those of each direction are scaled to what MORE times as many points say: of the correction, which hardly
    varies within a lobe, few know the mean.
    """
    generator, parts = generator_for(seed), []
    for some in torch.arange(len(where.ax)).split(CHUNK // fit.POINTS):
        here = where.part(some)
        lobes = glass_rows.lobes(KIND, here, above, MORE * fit.POINTS, generator)
        smith = smith_glass(here.repeated(MORE * fit.POINTS), lobes.wo.flatten(0, 1), first)
        smith = smith.unflatten(0, lobes.weights.shape) * lobes.weights[..., None]
        few = smith[:, : fit.POINTS] * MORE
        scale = smith.sum(1, keepdim=True) / few.sum(1, keepdim=True).clamp_min(1e-20)
        parts.append((lobes.wo[:, : fit.POINTS].flatten(0, 1), (few * scale.clamp(*SCALES)).flatten(0, 1)))
    wo, smith = (torch.cat(column) for column in zip(*parts, strict=True))
    return wo, smith
