"""Distilled lobes in a file, against eager: no random input, and small."""

from pathlib import Path

import pytest
import torch
from cases import DISTILLATES, TRACED, bsdf, each

from torchms.onnx import Evaluator, export


@each("scattering", DISTILLATES)
@pytest.mark.parametrize("distribution", ["ggx", pytest.param("beckmann", marks=pytest.mark.slow)])
def test_a_file_is_eager(scattering: str, distribution: str, tmp_path: Path, generator: torch.Generator) -> None:
    _compare(scattering, distribution, tmp_path, generator)


@pytest.mark.slow
@each("scattering", TRACED)
def test_a_file_of_traced_lobes_is_eager(scattering: str, tmp_path: Path, generator: torch.Generator) -> None:
    _compare(scattering, "beckmann", tmp_path, generator)


def _compare(scattering: str, distribution: str, tmp_path: Path, generator: torch.Generator) -> None:
    surface = bsdf("conductor[conductor]", scattering, distribution, dtype=torch.float32)
    path = export(surface, tmp_path / "distilled.onnx", parameters=("alpha", "alpha_y"))
    assert path.stat().st_size <= 100_000
    evaluator = Evaluator(path)
    wi, wo = torch.nn.functional.normalize(torch.randn(2, 5000, 3, generator=generator), dim=-1).abs()
    value, expected = evaluator(wi, wo, alpha=0.6, alpha_y=0.2), _at(surface, 0.6, 0.2)(wi, wo)
    error = (value - expected).abs() / expected.clamp_min(1e-3)
    assert float(error.quantile(0.999)) < 1e-5 and float(error.max()) < 1e-4


OTHERS = {"diffuse": {"alpha": 0.6, "alpha_y": 0.2}, "dielectric": {"alpha": 0.6, "alpha_y": 0.2, "eta": 1.7}}
"""Material → the file's inputs beside both directions, other than what it was exported with."""


@each("scattering", DISTILLATES)
@pytest.mark.parametrize("distribution", ["ggx", pytest.param("beckmann", marks=pytest.mark.slow)])
@pytest.mark.parametrize("material", OTHERS)
def test_a_file_of_glass_or_diffuse_facets_is_eager(
    scattering: str, distribution: str, material: str, tmp_path: Path, generator: torch.Generator
) -> None:
    """Glass from either side, to either side."""
    _compare_other(scattering, distribution, material, tmp_path, generator)


@pytest.mark.slow
@each("scattering", TRACED)
@pytest.mark.parametrize("material", OTHERS)
def test_a_file_of_traced_glass_or_diffuse_facets_is_eager(
    scattering: str, material: str, tmp_path: Path, generator: torch.Generator
) -> None:
    _compare_other(scattering, "beckmann", material, tmp_path, generator, 200_000)


def _compare_other(
    scattering: str,
    distribution: str,
    material: str,
    tmp_path: Path,
    generator: torch.Generator,
    most_bytes: int = 100_000,
) -> None:
    surface, given = bsdf(material, scattering, distribution, dtype=torch.float32), OTHERS[material]
    path = export(surface, tmp_path / "distilled.onnx", parameters=tuple(given))
    assert path.stat().st_size <= most_bytes
    wi, wo = torch.nn.functional.normalize(torch.randn(2, 5000, 3, generator=generator), dim=-1).abs()
    if material == "dielectric":
        wi, wo = torch.cat([wi, -wi]), torch.cat([wo, -wo.roll(1, 0)])[torch.randperm(10_000, generator=generator)]
    value, expected = Evaluator(path)(wi, wo, **given), _at(surface, *given.values())(wi, wo)
    error = (value - expected).abs() / expected.clamp_min(1e-3)
    assert float(error.quantile(0.999)) < 1e-5 and float(error.max()) < 1e-4


def _at(surface, alpha: float, alpha_y: float, eta: float | None = None):
    surface.distribution.alpha, surface.distribution.alpha_y = torch.tensor(alpha), torch.tensor(alpha_y)
    if eta is not None:
        surface.fresnel.eta = torch.tensor(eta)
    return surface
