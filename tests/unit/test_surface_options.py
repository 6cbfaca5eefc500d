"""A surface is described in the same way on every command line, from one table of names."""

import dataclasses
from typing import get_args

import pytest
import tyro

from torchms import (
    GGX,
    GTR,
    Beckmann,
    Distilled,
    HeightWalk,
    RoughConductor,
    RoughDielectric,
    RoughDiffuse,
    SingleBounce,
    Unidirectional,
)
from torchms.bsdfs.named import DISTRIBUTIONS, MATERIALS, SCATTERINGS, material_of, with_scattering
from torchms.cli import surface
from torchms.cli.arguments import parse_alpha, parse_count
from torchms.cli.commands import COMMANDS
from torchms.cli.description import described
from torchms.cli.export import build
from torchms.cli.options import EnergyOptions, ExportOptions, SimulateOptions
from torchms.cli.simulate import parts_of
from torchms.cli.surface import SurfaceOptions
from torchms.microsurface import GaussianSurfaces, Heightfield, facets_of, surfaces_of
from torchms.microsurface.simulation.materials import DielectricFacets, DiffuseFacets, MirrorFacets

pytestmark = pytest.mark.usefixtures("messages")
COPPER = "RoughConductor(Beckmann(0.6, 0.3), Conductor.metal('Cu'), SingleBounce())"


def test_the_names_of_the_parser_are_those_of_the_table() -> None:
    assert get_args(surface.Material) == tuple(MATERIALS)
    assert get_args(surface.Distribution) == tuple(DISTRIBUTIONS)
    assert get_args(surface.Scattering) == tuple(SCATTERINGS)


NO_SURFACE = ("lab", "lut", "fit-measured", "distil")
"""Commands that take no description of a surface."""


@pytest.mark.parametrize("command", [name for name in COMMANDS if name not in NO_SURFACE])
def test_every_command_takes_the_same_options(command: str) -> None:
    options, _ = COMMANDS[command]
    assert issubclass(options, SurfaceOptions)
    words = {"render": ["sphere", "--out", "a.png"], "export": ["a.onnx"]}.get(command, [])
    words += ["--alpha", "0.6,0.3", "--distribution", "beckmann", "--metal", "Cu"]
    by_name = described(tyro.cli(options, args=words), SingleBounce())
    short = [*words[:-6], "--bsdf", COPPER]
    by_expression = described(tyro.cli(options, args=short))
    assert str(by_name) == str(by_expression)


def test_short_options() -> None:
    for material, kind in MATERIALS.items():
        assert type(described(SurfaceOptions(material=material))) is kind
    assert type(described(SurfaceOptions(distribution="gtr", gamma=3.0)).distribution) is GTR
    facets = described(SurfaceOptions(alpha=0.5, alpha_y=0.2)).distribution
    assert isinstance(facets, GGX) and [float(a) for a in facets.alphas] == pytest.approx([0.5, 0.2])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"bsdf": COPPER, "material": "diffuse"}, "leave out --material"),
        ({"bsdf": COPPER, "alpha": "0.3"}, "leave out --alpha"),
        ({"bsdf": "GGX(0.3)"}, "not a BSDF"),
        ({"alpha": "0.5,0.2", "alpha_y": 0.2}, "--alpha-y goes with one number"),
        ({"metal": "Cu", "material": "diffuse"}, "--metal goes with"),
    ],
)
def test_what_does_not_fit(change: dict, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        described(SurfaceOptions(**change))


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({}, Distilled),
        ({"distribution": "beckmann", "metal": "Au"}, Distilled),
        ({"max_order": 3}, Unidirectional),
        ({"alpha": 1.5}, Unidirectional),
        ({"distribution": "gtr"}, Unidirectional),
        ({"material": "dielectric"}, HeightWalk),
        ({"scattering": "distilled", "material": "dielectric"}, Distilled),
        ({"bsdf": COPPER}, SingleBounce),
    ],
    ids=str,
)
def test_the_model_that_nobody_named(change: dict, kind: type) -> None:
    """What is learned, where it applies; not where bounces are counted."""
    assert type(build(ExportOptions("a.onnx", **change)).scattering) is kind


def test_counts() -> None:
    assert [parse_count(x, "--rays", 1) for x in ("1e6", 1e6, 1000000, "1000000")] == [1_000_000] * 4
    for bad in ("1.5", "0", 0.5, "inf", "many", float("nan")):
        with pytest.raises(ValueError, match="--rays must be a whole number"):
            parse_count(bad, "--rays", 1)
    for command in ("energy", "simulate", "figures", "export"):
        fields = {field.name: field.type for field in dataclasses.fields(COMMANDS[command][0])}
        counts = {"energy": ["samples"], "simulate": ["rays"], "figures": ["rays", "walks"], "export": ["rows"]}[
            command
        ]
        assert all(fields[name] == surface.Count for name in counts)
    assert parse_alpha("0.5,0.2") == [0.5, 0.2] and parse_alpha(0.5, 0.2) == [0.5, 0.2]


def test_the_scattering_is_exchanged_and_nothing_else() -> None:
    glass = RoughDielectric(Beckmann(0.5), described(SurfaceOptions(material="dielectric")).fresnel, mode="importance")
    other = with_scattering(glass, SingleBounce())
    assert isinstance(other, RoughDielectric) and other.mode == "importance" and other.fresnel is glass.fresnel
    chalk = with_scattering(RoughDiffuse(GGX(0.5), [0.2, 0.8]), HeightWalk(3))
    assert material_of(chalk) == "diffuse" and chalk.n_channels == 2 and chalk.max_order == 3
    with pytest.raises(ValueError, match="one side"):
        with_scattering(glass, SCATTERINGS["invariance"](2))


def test_a_simulation_takes_the_parts_of_a_bsdf() -> None:
    """The numbers are those that were written, not their float32."""
    bsdf = described(SurfaceOptions(bsdf=COPPER))
    assert isinstance(bsdf, RoughConductor)
    recipe, facets = surfaces_of(bsdf.distribution, count=3, size=256), facets_of(bsdf)
    assert (recipe.count, recipe.size) == (3, 256) and recipe.alpha == pytest.approx(0.6)
    assert isinstance(facets, MirrorFacets) and facets.fresnel is bsdf.fresnel
    assert isinstance(facets_of(described(SurfaceOptions(material="dielectric"))), DielectricFacets)
    assert isinstance(facets_of(described(SurfaceOptions(material="diffuse"))), DiffuseFacets)
    with pytest.raises(ValueError, match="Beckmann's normals; got GGX"):
        surfaces_of(GGX(0.5))
    for options in (
        SimulateOptions(bsdf=COPPER, surfaces=2, size=128),
        SimulateOptions(alpha="0.6,0.3", metal="Cu", surfaces=2, size=128),
        SimulateOptions(alpha=0.6, alpha_y=0.3, metal="Cu", surfaces=2, size=128),
    ):
        surfaces, facets = parts_of(options)
        assert surfaces == GaussianSurfaces(0.6, 0.3, 2, 128) and isinstance(facets, MirrorFacets)


def test_a_measured_surface_takes_any_distribution(tmp_path) -> None:
    path = tmp_path / "a.npy"
    Heightfield.gaussian(0.3, size=128, seed=1).export(path)
    options = SimulateOptions(surface=path, spacing=1.0, bsdf="RoughDiffuse(GGX(0.5), 0.8)", periodic=True)
    surface, facets = parts_of(options)
    assert isinstance(surface, Heightfield) and facets == DiffuseFacets([0.8])
    with pytest.raises(ValueError, match="Beckmann's normals"):
        parts_of(SimulateOptions(distribution="ggx"))


def test_energy_shows_the_model_of_the_expression() -> None:
    from torchms.cli.energy import _modelled

    bsdfs, _ = _modelled(EnergyOptions(bsdf=COPPER))
    assert list(bsdfs) == ["SingleBounce"]
    bsdfs, _ = _modelled(EnergyOptions(bsdf=COPPER, models=("height-walk", "kulla-conty")))
    assert list(bsdfs) == ["height-walk", "kulla-conty"]
