"""GTR in a file: one bounce and a walk, against eager. Slow: the sums over angles make large graphs."""

from pathlib import Path

import pytest
import torch

from torchms import GTR, Invariance, RoughConductor, Scattering, SingleBounce, Unidirectional
from torchms.fresnel import Conductor
from torchms.onnx import Evaluator, export


@pytest.mark.slow
@pytest.mark.parametrize("scattering", [SingleBounce(), Unidirectional(Invariance(), 2)], ids=["single", "walk"])
def test_a_file_is_eager(scattering: Scattering, tmp_path: Path, generator: torch.Generator) -> None:
    surface = RoughConductor(GTR(0.3, 1.2), Conductor([0.2, 0.9, 1.2], [3.9, 2.5, 2.2]), scattering)
    evaluator = Evaluator(export(surface, tmp_path / "gtr.onnx", parameters=("alpha", "gamma")))
    wi, wo = torch.nn.functional.normalize(torch.randn(2, 5000, 3, generator=generator), dim=-1).abs()
    walk = isinstance(scattering, Unidirectional)
    u = (surface.uniforms((5000,), generator=generator),) if walk else ()
    value, expected = evaluator(wi, wo, *u, alpha=0.3, gamma=1.2), surface(wi, wo, *u)
    error = (value - expected).abs() / expected.clamp_min(1e-6)
    assert float(error.max()) < 2e-4 and float(error.quantile(0.999)) < 2e-5
