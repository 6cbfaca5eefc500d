"""The only place that draws random numbers."""

import pytest
import torch
from cases import each

from torchms import GGX, RoughConductor, Uncorrelated, Unidirectional
from torchms.fresnel import Ideal
from torchms.sampling.uniforms import SEQUENCES, draw
from torchms.testing import chi_square_p_value


def seeded(seed: int = 7) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@each("sequence", SEQUENCES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize("batch", [(), (3,), (2, 0), (2, 3)], ids=str)
def test_shape_range_and_layout(sequence, dtype, batch):
    """(*batch, N, D) in [0, 1), each of the D numbers contiguous in memory."""
    u = draw(batch, 5, 4, sequence=sequence, dtype=dtype, generator=seeded())
    assert u.shape == (*batch, 5, 4) and u.dtype == dtype
    assert (u >= 0).all() and (u < 1).all()
    numbers = u.permute(-1, -2, *range(len(batch)))
    assert numbers.is_contiguous()
    assert all(n.is_contiguous() for n in numbers.unbind(0))


@each("sequence", SEQUENCES)
def test_a_generator_repeats(sequence):
    a, b, c = (draw((4,), 8, 3, sequence=sequence, generator=seeded(s)) for s in (1, 1, 2))
    assert torch.equal(a, b) and not torch.equal(a, c)


@each("sequence", SEQUENCES)
def test_numbers_are_uniform_and_rows_independent(sequence, generator, budget):
    """chi² of each number in 16 bins over rows, and of the pairs of two rows' and of two dimensions' numbers."""
    u = draw((4096,), 4, 3, sequence=sequence, generator=generator, dtype=torch.float64)
    cell = (16 * u[:, 0]).long()  # one path a row: the rows are independent in either sequence
    pairs = [cell[:, i] for i in range(3)]
    pairs += [cell[:, 0] // 4 * 4 + cell[:, 1] // 4, cell[:-1, 0] // 4 * 4 + cell[1:, 0] // 4]
    p = []
    for index in pairs:
        counts = torch.bincount(index, minlength=16)
        p.append(chi_square_p_value(counts, torch.full((16,), len(index) / 16, dtype=torch.float64)))
    budget(p)


def test_sobol_leaves_no_gaps():
    """N = 2^m points of a row, of any dimension, are at most 2 / N apart on the circle; random ones are not."""
    n = 64
    for sequence in SEQUENCES:
        x = draw((20,), n, 3, sequence=sequence, generator=seeded(), dtype=torch.float64).sort(1).values
        gaps = torch.cat([x[:, 1:] - x[:, :-1], x[:, :1] + 1 - x[:, -1:]], 1)
        assert (gaps.max() <= 2 / n + 1e-6) == (sequence == "sobol")


def test_a_sobol_number_never_rounds_to_one():
    """float32 would: 1 − 2^−26 is 1 there."""
    u = draw((2**14,), 16, 1, sequence="sobol", generator=seeded())
    assert float(u.max()) < 1


def test_a_bsdf_asks_for_what_it_needs():
    surface = RoughConductor(GGX(0.5), Ideal(), Unidirectional(Uncorrelated(), 3)).double()
    u = surface.uniforms((2,), 5, generator=seeded())
    assert u.shape == (2, 5, surface.n_uniforms) and u.dtype == torch.float64
    assert torch.equal(u, surface.uniforms((2,), 5, generator=seeded()))


@pytest.mark.usefixtures("messages")
@pytest.mark.parametrize(
    "arguments,message",
    [
        ({"n_paths": 0}, r"n_paths must be at least 1; got 0"),
        ({"sequence": "halton"}, r"sequence must be one of random, sobol; got 'halton'"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match=message):
        RoughConductor(GGX(0.5), Ideal()).uniforms((2,), **arguments)
