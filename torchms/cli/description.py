"""From the options that describe a surface to the surface."""

from dataclasses import fields

import torch

from torchms.approximations import Distilled
from torchms.bsdfs import BSDF
from torchms.bsdfs.named import DISTRIBUTIONS, SCATTERINGS, maker_of, with_scattering
from torchms.cli.arguments import parse_alpha
from torchms.cli.beforehand import check_surface, is_given
from torchms.cli.expression import parse_bsdf
from torchms.cli.options import ExportOptions, RenderOptions
from torchms.cli.surface import SurfaceOptions
from torchms.distributions import MicrofacetDistribution
from torchms.estimators import Scattering
from torchms.fresnel import Conductor, Dielectric, Ideal

SHORT = tuple(field.name for field in fields(SurfaceOptions) if field.name != "bsdf")


def described(options: SurfaceOptions, scattering: Scattering | None = None) -> BSDF:
    """The BSDF that the options describe, with `scattering` in its slot; None: that of the expression, or the usual one.

    Raises ValueError if options do not fit together.
    """
    check_surface(options)
    if options.bsdf is None:
        return _by_name(options, scattering)
    bsdf = parse_bsdf(options.bsdf)
    return bsdf if scattering is None else with_scattering(bsdf, scattering)


def exactly_described(options: SurfaceOptions, scattering: Scattering | None = None) -> BSDF:
    """`described` in float64: a simulation takes the very numbers that were written."""
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    try:
        return described(options, scattering)
    finally:
        torch.set_default_dtype(before)


def modelled(options: RenderOptions | ExportOptions, glass: str, opaque: str) -> BSDF:
    """The surface with the model of --scattering, of --max-order bounces. If none is named: with that of --bsdf, with the
    learned one of a BSDF without a scattering where it has one and nobody counts bounces, or else with `glass` or `opaque`.
    """
    if options.scattering is not None:
        return described(options, SCATTERINGS[options.scattering](options.max_order))
    if options.bsdf is not None:
        return described(options)
    usual = described(options)
    if isinstance(usual.scattering, Distilled) and not is_given(options, "max_order"):
        return usual
    return with_scattering(usual, SCATTERINGS[glass if usual.vertex.transmits else opaque](options.max_order))


def _by_name(options: SurfaceOptions, scattering: Scattering | None) -> BSDF:
    distribution = build_distribution(options)
    if options.material == "conductor":
        facet = Ideal() if options.metal is None else Conductor.metal(options.metal)
    else:
        facet = Dielectric(options.index) if options.material == "dielectric" else options.facet_albedo
    return maker_of(options.material)(distribution, facet, scattering)


def build_distribution(options: SurfaceOptions) -> MicrofacetDistribution:
    """The distribution that --distribution, --alpha and --gamma describe; ValueError if they do not fit together."""
    alphas = parse_alpha(options.alpha, options.alpha_y)
    name, gamma = options.distribution, options.gamma
    if name == "gtr":
        if len(alphas) > 1:
            raise ValueError(f"--distribution gtr is isotropic: --alpha must be one number; got {options.alpha!r}.")
        return DISTRIBUTIONS[name](alphas[0], 2.0 if gamma is None else gamma)
    return DISTRIBUTIONS[name](*alphas)
