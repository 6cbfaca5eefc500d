"""What a segment term must obey."""

import math
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from torchms.paths.segments import Leg, Segment
from torchms.sampling.uniforms import draw
from torchms.testing.plain import slope_error, unfinished
from torchms.testing.report import Check

PATHS = 400
LEGS = 40


def segment_laws(segment: Segment, samples: int, generator: torch.Generator) -> Iterator[Check]:
    """The laws of a segment; those of its closed term where it draws no heights."""

    def numbers(*shape: int) -> Tensor:
        return draw(shape, 1, 1, generator=generator, dtype=torch.float64)[..., 0, 0]

    def signed(k: int) -> Tensor:
        """Signed Λ (PATHS, k + 1): the first down, the last up, the others either."""
        size, up = 0.05 + 3 * numbers(PATHS, k + 1), numbers(PATHS, k + 1) < 0.5
        up[:, 0], up[:, -1] = False, True
        return torch.where(up, size, -1 - size)

    def walked(Lambda: Tensor, n: int) -> list[Tensor]:
        """e_1, e_2, … along the signed Λ (…, legs), mean over `n` heights; directions are those given."""
        drawn = range(segment.n_uniforms)
        legs = [Leg(x.abs(), x >= 0, numbers=tuple(numbers(n, *x.shape) for _ in drawn)) for x in Lambda.unbind(-1)]
        state = segment.start(legs[0], False)
        escapes = []
        for leg in legs[1:]:
            escapes.append(segment.escape(state, leg))
            state = segment.extend(state, leg)
        return [e.expand(n, *Lambda.shape[:-1]).mean(0) for e in escapes]

    def nothing_is_lost() -> float:
        # Legs that go up gently are left by; after so many of them nothing stays.
        Lambda = torch.cat([-1.3 - numbers(8, 2), 0.05 + 0.2 * numbers(8, LEGS)], -1)
        total = torch.stack(walked(Lambda, 1 if segment.n_uniforms == 0 else samples // 8)).sum(0)
        return float((total - 1).abs().max())

    def is_a_probability() -> float:
        escapes = torch.stack(walked(signed(6), 1))
        return float(torch.maximum(-escapes.min(), escapes.sum(0).max() - 1))

    yield Check("escapes are a probability", is_a_probability, 1e-9)
    yield Check("escape + stay = 1", nothing_is_lost, 1e-6 if segment.n_uniforms == 0 else 6 / math.sqrt(samples / 8))
    if segment.n_uniforms:
        return

    def reciprocal() -> float:
        return max(_largest_ratio(segment(x), segment(-1 - x.flip(-1))) for x in map(signed, range(1, 6)))

    def dark() -> float:
        Lambda = signed(2)
        wrong = [torch.where(torch.arange(3) == i, -1 - Lambda, Lambda) for i in (0, 2)]
        return max(float(segment(x).abs().max()) for x in wrong)

    yield Check("no light from below or into the ground", dark, 0.0)
    if segment.is_reciprocal:
        yield Check("the reversed path has the same term", reciprocal, 1e-9)
    yield Check("values and gradients are finite", lambda: finite(segment), 0.0)
    yield Check("gradients are slopes", lambda: slopes(segment, signed(4)[:6]), 1e-5)


def _largest_ratio(a: Tensor, b: Tensor) -> float:
    return float(((a - b).abs() / (a.abs() + b.abs()).clamp_min(1e-30)).nan_to_num(1.0).max())


def finite(segment: Segment) -> tuple[float, str]:
    """Normalised terms where Λ is 0, tiny, 1 and as large as at the horizon, in every order of three legs."""
    sizes = torch.tensor([0.0, 1e-12, 1.0, 1e7], dtype=torch.float64)
    sizes = torch.cartesian_prod(sizes, sizes, sizes).requires_grad_()
    outputs = {}
    for turns in (True, False):
        ups = (False, turns, True)
        columns = zip(sizes.unbind(-1), ups, strict=True)
        legs = [Leg(x if up else 1 + x, torch.full_like(x, up, dtype=torch.bool)) for x, up in columns]
        state = segment.extend(segment.start(legs[0], False), legs[1])
        outputs["e_2, middle " + ("up" if turns else "down")] = segment.escape(state, legs[2])
    return unfinished(outputs, {"Λ": sizes})


def slopes(segment: Segment, Lambda: Tensor) -> float:
    """Of the closed term in every |Λ|."""

    def term(values: Sequence[Tensor]) -> Tensor:
        return segment(torch.stack(list(values), -1))

    return slope_error(term, list(Lambda.unbind(-1)))
