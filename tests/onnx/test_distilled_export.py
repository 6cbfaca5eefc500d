"""Distilled lobes in a file, against eager: no random input, and small."""

from pathlib import Path

import pytest
import torch
from cases import DISTILLATES, TRACED, bsdf, each

from torchms.onnx import Evaluator, export


@each("scattering", DISTILLATES)
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_a_file_is_eager(scattering: str, distribution: str, tmp_path: Path, generator: torch.Generator) -> None:
    _compare(scattering, distribution, tmp_path, generator)


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


def _at(surface, alpha: float, alpha_y: float):
    surface.distribution.alpha, surface.distribution.alpha_y = torch.tensor(alpha), torch.tensor(alpha_y)
    return surface
