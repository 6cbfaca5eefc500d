"""What is exported: a module whose inputs are named tensors, and the parameters that may be among them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.overrides import TorchFunctionMode

from torchms.bsdfs import kernels
from torchms.bsdfs.base import BSDF
from torchms.evaluation import blocks
from torchms.evaluation.numbers import source
from torchms.parameters.declared import Parameter
from torchms.parameters.exchange import declarations, parameters, weights, with_parameters
from torchms.sampling.point_sets import BITS, sobol
from torchms.sampling.stream import Stream

WHATS = ("forward", "orders", "sample", "pdf")
UNIFORMS = ("input", "sobol", "seed")


@dataclass(frozen=True)
class Slot:
    """A parameter of a BSDF: its name as a graph input, its dotted name in the BSDF, what is declared of it."""

    name: str
    dotted: str
    record: Parameter
    value: Tensor | None


def slots(bsdf: BSDF) -> dict[str, Slot]:
    """Every parameter of `bsdf` by its name; a name that stands for two of them is replaced by the dotted ones."""
    found: dict[str, list[Slot]] = {}
    for dotted, record, value in declarations(bsdf):
        found.setdefault(record.argument, []).append(Slot(record.argument, dotted, record, value))
    single = {name: group[0] for name, group in found.items() if len(group) == 1}
    several = {slot.dotted: slot for group in found.values() if len(group) > 1 for slot in group}
    return single | several


def replaced(bsdf: BSDF, values: dict[Slot, Tensor], dtype: torch.dtype | None = None) -> BSDF:
    """A copy of `bsdf` with these values in their slots and the others, weights included, in `dtype`; nothing is validated."""
    others = {name: value.detach() for name, (_, value) in parameters(bsdf).items()}
    if dtype is not None:
        # Networks and tables compute in the dtype of what they are given.
        others |= {name: x.detach() for name, x in weights(bsdf).items() if x.is_floating_point()}
        others = {name: x.to(dtype) for name, x in others.items()}
    return with_parameters(bsdf, others | {slot.dotted: value for slot, value in values.items()})


class Graph(nn.Module):
    """`what` of a BSDF as a function of positional tensors: wi, [wo], [u or seed], parameters."""

    shared: Tensor | None

    def __init__(self, bsdf: BSDF, what: str, inputs: Sequence[Slot], uniforms: str, n_paths: int | None) -> None:
        super().__init__()
        self.bsdf, self.what, self.slots = bsdf, what, tuple(inputs)
        self.uniforms = uniforms if self.draws else "none"
        self.n_paths = n_paths if self.draws else 1
        self.register_buffer("shared", self._sobol() if self.uniforms == "sobol" else None)

    @property
    def draws(self) -> bool:
        """Whether random numbers are needed."""
        if self.what in ("forward", "orders"):
            return not self.bsdf.scattering.is_deterministic(self.bsdf.vertex)
        return self.what == "sample"

    @property
    def n_uniforms(self) -> int:
        """D, the numbers of one path; `sample` uses the first few of those that the eager method takes."""
        return self.bsdf.proposal.n_uniforms if self.what == "sample" else self.bsdf.n_uniforms

    @property
    def input_names(self) -> list[str]:
        directions = ["wi"] if self.what == "sample" else ["wi", "wo"]
        numbers = {"input": ["u"], "seed": ["seed"]}.get(self.uniforms, [])
        return directions + numbers + [slot.name for slot in self.slots]

    @property
    def output_names(self) -> list[str]:
        return {"forward": ["value"], "orders": ["orders"], "sample": ["wo", "pdf"], "pdf": ["pdf"]}[self.what]

    def example(self, rows: int = 3) -> tuple[Tensor, ...]:
        """Inputs of the right shapes."""
        dtype, C = self.bsdf.dtype, self.bsdf.n_channels
        direction = torch.tensor([0.6, 0.0, 0.8], dtype=dtype).expand(rows, 3).clone()
        known = {
            "wi": direction,
            "wo": direction.clone(),
            "u": torch.full((rows, self.n_paths or 2, self.n_uniforms), 0.5, dtype=dtype),
            "seed": torch.arange(rows),
        }
        for slot in self.slots:
            value = torch.full((), 0.5, dtype=dtype) if slot.value is None else slot.value.detach()
            if slot.record.channels:
                value = value.reshape(-1, value.shape[-1])[0]
                known[slot.name] = value.expand(rows, C).clone()
            else:
                known[slot.name] = value.reshape(-1)[0].expand(rows).clone()
        return tuple(known[name] for name in self.input_names)

    def dynamic_shapes(self) -> tuple[dict[int, str], ...]:
        """Names of the axes that are free: the batch, and the paths of `u` if their number was not given."""
        return tuple(
            {0: "batch", 1: "paths"} if name == "u" and self.n_paths is None else {0: "batch"}
            for name in self.input_names
        )

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        given = dict(zip(self.input_names, inputs, strict=True))
        with ExactScalars(self.bsdf.dtype):
            bsdf = self.substituted(given)
            wi, wo = given["wi"], given.get("wo")
            if self.what == "sample":
                # Past the check that `u` has all the numbers of a path: a sample uses only its own.
                numbers = source(self.numbers(given), self.n_uniforms, bsdf.dtype)
                return blocks.run(kernels.SAMPLE, bsdf, (wi,), numbers)
            assert wo is not None
            if self.what == "pdf":
                return (bsdf.pdf(wi, wo),)
            return (getattr(bsdf, self.what)(wi, wo, self.numbers(given)),)

    def substituted(self, given: dict[str, Tensor], dtype: torch.dtype | None = None) -> BSDF:
        """The BSDF with the given parameters, the others in `dtype`."""
        return replaced(self.bsdf, {slot: given[slot.name] for slot in self.slots}, dtype)

    def numbers(self, given: dict[str, Tensor]) -> Tensor | Stream | None:
        """The random numbers."""
        if self.uniforms == "input":
            return given["u"]
        if self.uniforms == "seed":
            return Stream(given["seed"], self.n_paths or 1)
        return self.shared

    def _sobol(self) -> Tensor:
        """(N, D) points that serve every row."""
        assert self.n_paths is not None
        return (sobol(self.n_paths, self.n_uniforms).T / (1 << BITS)).to(self.bsdf.dtype)


class ExactScalars(TorchFunctionMode):
    """Turns the Python numbers of float64 code into tensors, because the exporter rounds them to float32."""

    def __init__(self, dtype: torch.dtype) -> None:
        super().__init__()
        self.dtype = dtype

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = getattr(func, "__name__", "")
        if self.dtype == torch.float64 and name in _ARITHMETIC:
            # Two numbers to choose from are float32 whatever they are.
            always = name == "where" and not any(isinstance(a, Tensor) for a in args[1:])
            args = tuple(self._exact(a, always) for a in args)
        return func(*args, **(kwargs or {}))

    def _exact(self, value: Any, always: bool) -> Any:
        if isinstance(value, float) and (always or float(torch.tensor(value, dtype=torch.float32)) != value):
            return torch.tensor(value, dtype=self.dtype)
        return value


_ARITHMETIC = {
    *("add", "sub", "mul", "div", "true_divide", "rsub", "where", "pow", "maximum", "minimum"),
    *("clamp_min", "clamp_max", "gt", "ge", "lt", "le"),
    *(f"__{prefix}{name}__" for prefix in ("", "r") for name in ("add", "sub", "mul", "truediv", "div", "pow")),
    *("__gt__", "__ge__", "__lt__", "__le__"),
}
