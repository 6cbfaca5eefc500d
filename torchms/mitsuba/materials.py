"""What the plugins are made of: which torchms surface, and which of its numbers Mitsuba's parameters are."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from torchms.approximations import Distilled
from torchms.approximations.coordinates import ETA
from torchms.bsdfs import BSDF, MetallicRoughness, RoughConductor, RoughDielectric, RoughDiffuse
from torchms.bsdfs.metallic_roughness import BOUNCES, DIFFUSE
from torchms.distributions import GGX, Beckmann
from torchms.estimators import HeightWalk, Scattering, Unidirectional
from torchms.fresnel import Conductor, Dielectric
from torchms.mitsuba.parameters import borrowed
from torchms.mitsuba.recorded import Recorded
from torchms.paths.segments import Invariance

DISTRIBUTIONS = {"beckmann": Beckmann, "ggx": GGX}
LIMITS = {"distilled": (0.03, 1.0), "exact": GGX.limits}
"""What sums the bounces, and the range of α."""
EXAMPLE = 0.5
"""Any α in range: a recorded kernel does not depend on it."""


@dataclass(frozen=True)
class Choice:
    """What tells the recorded kernels of a plugin apart. words: those of its `Material.words`, in that order."""

    words: tuple[str, ...]
    isotropic: bool
    max_order: int
    n_channels: int
    mode: str

    def facets(self) -> GGX | Beckmann:
        return DISTRIBUTIONS[self.words[0]](EXAMPLE, None if self.isotropic else EXAMPLE)

    def sum_of_bounces(self, exact: Callable[[int], Scattering]) -> Scattering:
        return Distilled() if self.words[1] == "distilled" else exact(self.max_order)


@dataclass(frozen=True)
class Material:
    """One plugin.

    read: its own parameters from Mitsuba's properties. own: torchms' name of a parameter → Mitsuba's.
    scales: factors of what is reflected and transmitted. components: names in `mitsuba.BSDFFlags`, reflection first.
    ranges: where its own parameters may lie. words: name of a property → what it may be, the default first.
    """

    make: Callable[[Choice], BSDF]
    read: Callable[[Any], dict[str, Any]]
    own: Mapping[str, str]
    scales: tuple[str, ...]
    components: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    words: Mapping[str, tuple[str, ...]] = field(
        default_factory=lambda: {"distribution": tuple(DISTRIBUTIONS), "scattering": tuple(LIMITS)}
    )


def _walk(max_order: int) -> Scattering:
    return Unidirectional(Invariance(), max_order)


def _conductor(c: Choice) -> BSDF:
    index = [1.0] * c.n_channels
    return RoughConductor(c.facets(), Conductor(index, index), c.sum_of_bounces(_walk))


def _dielectric(c: Choice) -> BSDF:
    return RoughDielectric(c.facets(), Dielectric(1.5), c.sum_of_bounces(HeightWalk), c.mode)


def _diffuse(c: Choice) -> BSDF:
    return RoughDiffuse(c.facets(), [0.5] * c.n_channels, c.sum_of_bounces(_walk))


def _metallic_roughness(c: Choice) -> BSDF:
    diffuse, bounces = c.words
    bent = 0.0 if c.isotropic else EXAMPLE
    return MetallicRoughness([0.5] * c.n_channels, EXAMPLE, EXAMPLE, anisotropy=bent, diffuse=diffuse, bounces=bounces)


def _metal(props: Any) -> dict[str, Any]:
    if "eta" not in props and "k" not in props:
        return {name: borrowed("roughconductor", props, ("material",), name) for name in ("eta", "k")}
    if "material" in props:
        raise ValueError("torchms_conductor: give either material, or eta and k; got both.")
    return {name: props.get_unbounded_texture(name) for name in ("eta", "k")}


def _glass(props: Any) -> dict[str, Any]:
    if "eta" not in props:
        mi, eta = import_module("mitsuba"), borrowed("roughdielectric", props, ("int_ior", "ext_ior"), "eta")
        # A number of Python's cannot be moved from outside, a texture of one can.
        return {"eta": mi.load_dict({"type": "uniform", "value": eta}) if mi.Float is float else mi.Float(eta)}
    if "int_ior" in props or "ext_ior" in props:
        raise ValueError("torchms_dielectric: give either eta, the ratio int_ior / ext_ior, or those; got both.")
    return {"eta": props.get_unbounded_texture("eta")}


def _chalk(props: Any) -> dict[str, Any]:
    return {"reflectance": props.get_texture("reflectance", 0.5)}


def _gltf(props: Any) -> dict[str, Any]:
    defaults = {"base_color": 0.5, "metallic": 0.0, "roughness": 0.5, "eta": 1.5}
    found = {name: props.get_unbounded_texture(name, default) for name, default in defaults.items()}
    return found | ({"anisotropy": props.get_texture("anisotropy")} if "anisotropy" in props else {})


SHARE = (0.0, 1.0)
MATERIALS = {
    "torchms_conductor": Material(
        _conductor,
        _metal,
        {"fresnel.eta": "eta", "fresnel.k": "k"},
        ("specular_reflectance",),
        ("GlossyReflection",),
    ),
    "torchms_dielectric": Material(
        _dielectric,
        _glass,
        {"fresnel.eta": "eta"},
        ("specular_reflectance", "specular_transmittance"),
        ("GlossyReflection", "GlossyTransmission"),
        {"eta": (1 / ETA, ETA)},
    ),
    "torchms_diffuse": Material(_diffuse, _chalk, {"reflectance": "reflectance"}, (), ("DiffuseReflection",)),
    "torchms_metallic_roughness": Material(
        _metallic_roughness,
        _gltf,
        {name: name for name in ("base_color", "metallic", "roughness", "anisotropy")} | {"ior": "eta"},
        (),
        ("GlossyReflection",),
        {name: SHARE for name in ("base_color", "metallic", "roughness", "anisotropy")} | {"eta": (1.0, 3.0)},
        {"diffuse": DIFFUSE, "bounces": BOUNCES},
    ),
}
ALPHAS = {"distribution.alpha": "alpha_u", "distribution.alpha_y": "alpha_v"}


@functools.cache
def recorded(name: str, choice: Choice) -> Recorded:
    """The kernels of a plugin; equal ones are recorded once a process."""
    return Recorded(MATERIALS[name].make(choice))
