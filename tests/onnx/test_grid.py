"""The grid that files are compared over: every parameter goes through the whole range that it is declared for."""

import pytest
import torch
from cases import DISTRIBUTIONS

from torchms import RoughConductor, RoughDiffuse, SingleBounce
from torchms.fresnel import Conductor, Ideal, Schlick
from torchms.onnx.exporter import checked
from torchms.onnx.parity.grid import grid

SURFACES = {
    **{name: RoughConductor(make(0.5), Ideal(), SingleBounce()) for name, make in DISTRIBUTIONS.items()},
    "metal": RoughConductor(DISTRIBUTIONS["ggx"](0.5), Conductor([0.2, 0.9], [3.9, 2.5]), SingleBounce()),
    "schlick": RoughConductor(DISTRIBUTIONS["ggx"](0.5), Schlick([0.1, 0.9]), SingleBounce()),
    "diffuse": RoughDiffuse(DISTRIBUTIONS["ggx"](0.5), [0.1, 0.9], SingleBounce()),
}


@pytest.mark.parametrize("name", SURFACES)
def test_parameters_are_drawn_by_their_range(name: str) -> None:
    """Within the range and near both of its ends; the indices of refraction have no end: they differ, and fit."""
    graph = checked(SURFACES[name], "forward", tuple(checked_names(name)), "input", 1)
    inputs = grid(graph, 20_000)
    for slot in graph.slots:
        values, record = inputs[slot.name].double(), slot.record
        # What float32 makes of the ends.
        slack = 1e-6 * max(abs(record.low), 1e-6)
        assert float(values.min()) >= record.low - slack and float(values.max()) <= record.high * (1 + 1e-6), slot.name
        if record.open_low:
            assert float(values.min()) > record.low
        if record.high < 1e5:
            share = (values - record.low) / (record.high - record.low)
            assert float(share.min()) < 0.01 and float(share.max()) > 0.99, slot.name
        assert len(values.unique()) > 1000


def checked_names(name: str) -> list[str]:
    """All parameters of the surface that have a value."""
    from torchms.onnx.graph import slots

    return [slot.name for slot in slots(SURFACES[name]).values() if slot.value is not None]


def test_gamma_is_drawn_over_all_of_its_range() -> None:
    gamma = grid(checked(SURFACES["gtr"], "forward", ("gamma",), "input", 1), 20_000)["gamma"]
    histogram = torch.histc(gamma.double(), 10, 0.0, 10.0)
    assert bool((histogram > 1000).all()), histogram
