"""Every public method of every surface on a device that is not the CPU, without one: fake tensors, which know shapes,
dtypes and devices, and refuse operations of tensors on two devices, forward and backward.

    python tests/any_device.py quick|slow

A program of its own, as it gives the process a device for good. Prints one line a failure; exit status 1 if there is one.
"""

import sys
import time
from collections.abc import Iterator
from unittest.mock import patch

import torch
from cases import COMPENSATIONS, HEAVY, METHODS, alphas_for, bsdf, is_dear, surfaces
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils.backend_registration import _setup_privateuseone_for_python_backend

from torchms import BSDF, Stream
from torchms.parameters.exchange import parameters, weights, with_parameters

DEVICE = "gpu"
ROWS, PATHS = 4, 2
SEQUENCES = ("random", "sobol", "rank1")


def models(quick: bool) -> Iterator[tuple[str, ...]]:
    """The quick ones have between them every distribution, every cheap scattering, and all materials with other code."""
    seen = set()
    for case in surfaces().args[1]:
        material, scattering, distribution = case.values
        parts = {
            distribution,
            scattering,
            (material, scattering == "height-walk"),
            (material, scattering in COMPENSATIONS),
        }
        dear = scattering in HEAVY or is_dear(distribution, scattering)
        if (not dear and not parts <= seen) == quick:
            yield case.values
        seen |= set() if dear else parts


CALLS = (
    ("forward", "stream"),
    ("sample", "stream"),
    ("pdf", "tensor"),
    ("sample_walk", "tensor"),
    ("albedo", "stream"),
)
"""Every kernel, and both forms of the random numbers; `orders` has the kernel of `forward`."""


def leaves(surface: BSDF) -> dict[str, Tensor]:
    """A map of each parameter that wants a gradient, on the device."""
    return {
        name: torch.rand((ROWS, *value.shape[len(record.batch(value)) :]), device=DEVICE, requires_grad=True)
        for name, (record, value) in parameters(surface).items()
    }


def check(surface: BSDF) -> Iterator[str]:
    """What does not stay on the device."""
    given = leaves(surface)
    there = with_parameters(
        surface, given | {name: torch.empty_like(x, device=DEVICE) for name, x in weights(surface).items()}
    )
    assert there.device.type == DEVICE
    wi, wo = (torch.rand(ROWS, 3, device=DEVICE, requires_grad=True) for _ in range(2))
    numbers = {"tensor": there.uniforms((ROWS,), PATHS), "stream": Stream(3, PATHS)}
    for method, form in CALLS:
        try:
            outputs = METHODS[method](there, wi, wo, numbers[form])
            total = sum(x.sum() for x in outputs if x.requires_grad)
            gradients = torch.autograd.grad(total, [wi, wo, *given.values()], allow_unused=True)
        except Exception as error:
            yield f"{method} with a {form}: {type(error).__name__}: {str(error).splitlines()[0][:300]}"
            continue
        for x in (*outputs, *gradients):
            if x is not None and x.device.type != DEVICE:
                yield f"{method} with a {form}: a result on {x.device}"


class FakeSobol:
    """In place of torch's own, which works on the CPU only, and on numbers."""

    def __init__(self, dimension: int, scramble: bool, seed: int) -> None:
        self.dimension = dimension

    def draw(self, n: int, dtype: torch.dtype) -> Tensor:
        return torch.rand(n, self.dimension, dtype=dtype)


@patch("torch.randint", return_value=7)  # the host reads the seed of the scrambling
@patch("torchms.sampling.uniforms.SobolEngine", FakeSobol)
def check_numbers(surface: BSDF, _: object) -> list[str]:
    """What random numbers are drawn on."""
    found = []
    for sequence in ("random", "sobol"):
        on_cpu = torch.Generator().manual_seed(1)
        for label, given, expected in (
            ("", {"device": DEVICE}, DEVICE),
            (" beside a surface on the CPU", {}, "cpu"),
            (" from a generator on the CPU", {"device": DEVICE, "generator": on_cpu}, DEVICE),
        ):
            if surface.uniforms((ROWS,), PATHS, sequence=sequence, **given).device.type != expected:
                found.append(f"uniforms of {sequence}{label}")
    seeds = torch.arange(ROWS, device=DEVICE)
    for stream in (*(Stream(1, PATHS, sequence) for sequence in SEQUENCES), Stream(seeds, PATHS)):
        if stream.uniforms((ROWS,), surface.n_uniforms, device=DEVICE).device.type != DEVICE:
            found.append(f"uniforms of {stream}")
    if Stream(seeds).uniforms((ROWS,), 3).device.type != DEVICE:
        found.append("uniforms of seeds on the device")
    return found


def main(which: str) -> int:
    failures = []
    shared = bsdf("conductor[conductor]", "invariance", max_order=2, dtype=torch.float32)
    for sequence in SEQUENCES:  # the shared points hold real numbers, whoever asks for them
        Stream(1, PATHS, sequence).uniforms((1,), shared.n_uniforms)
    built = {
        names: bsdf(*names, alphas_for(*names[:2]), max_order=2, dtype=torch.float32)
        for names in models(which == "quick")
    }
    _setup_privateuseone_for_python_backend(DEVICE)
    torch._C._set_only_lift_cpu_tensors(True)
    with FakeTensorMode(allow_non_fake_inputs=True):
        try:
            torch.rand(2, device=DEVICE) + torch.rand(2)
        except RuntimeError:
            pass
        else:
            failures.append("fake tensors of two devices can be added: nothing here means anything")
        failures += check_numbers(shared)
        for names, surface in built.items():
            start = time.process_time()
            failures += [f"{'-'.join(names)}, {line}" for line in check(surface)]
            print(f"{'-'.join(names)}: {time.process_time() - start:.2f} s", file=sys.stderr, flush=True)
    print(*failures, sep="\n")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
