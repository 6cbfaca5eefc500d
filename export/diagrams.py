"""Files about a distribution alone: masking on the full sphere, the caps of visible normals, GTR's closed forms.

They are traced, named and sealed like the evaluators; `wi` is the direction, as everywhere.
"""

import json
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from torchms import RoughConductor
from torchms.distributions.base import MicrofacetDistribution
from torchms.distributions.ggx import GGX
from torchms.distributions.gtr_closed import CLOSED_FORMS
from torchms.fresnel import Ideal
from torchms.maths.frame import normalized, split
from torchms.onnx import seal
from torchms.onnx.graph import Graph, slots
from torchms.onnx.tracing import traced
from torchms.paths.masking import G1_dist
from torchms.version import __version__


class Diagram(Graph):
    """`compute(distribution, given)` as a graph: inputs `names`, then parameters of the distribution."""

    def __init__(
        self,
        distribution: MicrofacetDistribution,
        what: str,
        names: Sequence[str],
        parameters: Sequence[str],
        compute: Callable[[MicrofacetDistribution, dict[str, Tensor]], Tensor],
    ) -> None:
        bsdf = RoughConductor(distribution, Ideal())
        known = slots(bsdf)
        super().__init__(bsdf, what, [known[name] for name in parameters], "none", 1)
        self.names, self.compute = list(names), compute

    @property
    def draws(self) -> bool:
        return False

    @property
    def input_names(self) -> list[str]:
        return self.names + [slot.name for slot in self.slots]

    @property
    def output_names(self) -> list[str]:
        return [self.what]

    def example(self, rows: int = 3) -> tuple[Tensor, ...]:
        known = {"wi": torch.tensor([0.6, 0.0, 0.8]).expand(rows, 3).clone()}
        return tuple(known.get(name, torch.full((rows,), 0.5)) for name in self.input_names)

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        given = dict(zip(self.input_names, inputs, strict=True))
        return (self.compute(self.substituted(given).vertex.distribution, given),)


def masking(distribution: MicrofacetDistribution, parameters: Sequence[str]) -> Diagram:
    """G1(wi) [1] on the full sphere [Wang2022] Eq. 3: (batch); above 1 below the horizon."""
    return Diagram(distribution, "G1", ["wi"], parameters, lambda d, given: G1_dist(d, given["wi"]))


def caps() -> Diagram:
    """Lowest stretched z of a reflection of `wi`, (batch, 3): the spherical cap [Dupuy2023], the bounded one, and that of
    reflections on the horizon at longitude `phi` [rad] [Tokuyoshi2023], supplement Fig. 1."""
    return Diagram(GGX(0.5, 0.5), "delta", ["wi", "phi"], ("alpha", "alpha_y"), _caps)


def _caps(distribution: MicrofacetDistribution, given: dict[str, Tensor]) -> Tensor:
    assert isinstance(distribution, GGX)
    w = split(given["wi"])
    s = normalized(distribution.stretched(w))
    return torch.stack([-s.z, -distribution.bound(w) * s.z, distribution.horizon_bound(w, given["phi"])], -1)


def closed_forms() -> Diagram:
    """G1 of GTR for γ = 0, 1, 2, 3, 4 [Dimov2015], (batch, 5), of `mu` = cot θ > 0 and `roughness` = α."""

    def compute(distribution: MicrofacetDistribution, given: dict[str, Tensor]) -> Tensor:
        return torch.stack([form(given["mu"], given["roughness"]) for form in CLOSED_FORMS], -1)

    return Diagram(GGX(0.5), "forms", ["mu", "roughness"], (), compute)


def diagram_bytes(diagram: Diagram) -> bytes:
    """The file of a diagram."""
    model = traced(diagram)
    inputs = []
    for name in diagram.input_names:
        inputs.append({"name": name, "dtype": "float32", "shape": ["batch", 3] if name == "wi" else ["batch"]})
    entries = {
        "torchms.version": __version__,
        "torchms.what": diagram.what,
        "torchms.conventions": "Directions are unit vectors in the local frame, +z the macro-normal, pointing away.",
        "torchms.inputs": json.dumps(inputs),
    }
    del model.metadata_props[:]
    for key, value in entries.items():
        model.metadata_props.add(key=key, value=value)
    model.producer_name, model.producer_version = "torchms", __version__
    return seal.sealed(model.SerializeToString(deterministic=True))
