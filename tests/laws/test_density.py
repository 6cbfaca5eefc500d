"""`pdf` is the density of `sample`."""

import pytest
import torch
from cases import ALPHAS, ANGLES, DISTRIBUTIONS, ONE_OF_EACH, bsdf, direction, each, sides

from torchms.testing import chi_square_p_value, sphere_cells
from torchms.testing.chi_square import cell_index

CELLS = (32, 32)


@each("material", ONE_OF_EACH)
@each("distribution", DISTRIBUTIONS)
@each("alpha", ALPHAS)
@each("theta", ANGLES)
def test_pdf_is_normalised_and_sample_follows_it(material, distribution, alpha, theta, generator, budget):
    """∫ pdf dwo = 1 ± 1e-3, chi² of 100 000 samples, and the `pdf` that `sample` returns is `pdf` there."""
    surface = bsdf(material, "single", distribution, ALPHAS[alpha])
    p = []
    for side in sides(material):
        wi = side * direction(theta)
        expected = sphere_cells(lambda w: surface.pdf(wi, w), CELLS, 2e-4)
        assert float(expected.sum()) == pytest.approx(1, abs=1e-3)
        wo, pdf = surface.sample(wi, surface.uniforms((), 100_000, generator=generator))
        torch.testing.assert_close(pdf, surface.pdf(wi, wo), rtol=1e-9, atol=0)
        counts = torch.bincount(cell_index(wo, CELLS), minlength=CELLS[0] * CELLS[1])
        p.append(chi_square_p_value(counts, expected.reshape(-1) / expected.sum() * len(wo)))
    budget(p)
