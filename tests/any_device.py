"""Every public method of every surface on a device that is not the CPU, without one: fake tensors, which know shapes,
dtypes and devices, and refuse operations of tensors on two devices, forward and backward.

    python tests/any_device.py quick|slow

A program of its own, as it gives the process a device for good. Prints one line a failure; exit status 1 if there is one.
"""

import os
import sys
import time
from collections.abc import Iterable, Iterator
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import torch
from cases import COMPENSATIONS, DISTILLATES, HEAVY, METHODS, alphas_for, bsdf, is_dear, surfaces
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils.backend_registration import _setup_privateuseone_for_python_backend

from torchms import BSDF, MetallicRoughness, Stream
from torchms.dropins import GGX_specular, pbr_bsdf
from torchms.dropins.pypbr import CookTorranceBRDF
from torchms.parameters.exchange import parameters, weights, with_parameters
from torchms.shading import alpha, alphas, sample, shade

DEVICE = "gpu"
ROWS, PATHS = 4, 2
APPROXIMATIONS = (*COMPENSATIONS, *DISTILLATES)
SEQUENCES = ("random", "sobol", "rank1")


def models(quick: bool) -> Iterator[tuple[str, ...]]:
    """The quick ones have between them every distribution, every family of scatterings, and all materials with other code."""
    seen = set()
    for case in surfaces().args[1]:
        material, scattering, distribution = case.values
        family = "compensation" if scattering in COMPENSATIONS else scattering.partition("-")[0]
        parts = {
            distribution,
            family,
            (material, scattering == "height-walk"),
            (material, scattering in COMPENSATIONS),
        }
        dear = scattering in HEAVY or is_dear(distribution, scattering)
        if (not dear and not parts <= seen) == quick:
            yield case.values
        seen |= set() if dear else parts


CALLS = {
    "forward": "stream",
    "sample_walk": "tensor",
    "albedo": "stream",
    "sample": "stream",
    "pdf": "tensor",
}
"""Every kernel with a form of the random numbers; `orders` has the kernel of `forward`."""
OF_A_SCATTERING = ("forward", "sample_walk")
"""The kernels that differ between scatterings; the quick run takes the others with one of them."""


def leaves(surface: BSDF) -> dict[str, Tensor]:
    """A map of each parameter that wants a gradient, on the device."""
    return {
        name: torch.rand((ROWS, *value.shape[len(record.batch(value)) :]), device=DEVICE, requires_grad=True)
        for name, (record, value) in parameters(surface).items()
    }


def check(surface: BSDF, methods: Iterable[str]) -> Iterator[str]:
    """What does not stay on the device."""
    given = leaves(surface)
    there = with_parameters(
        surface, given | {name: torch.empty_like(x, device=DEVICE) for name, x in weights(surface).items()}
    )
    assert there.device.type == DEVICE
    wi, wo = (torch.rand(ROWS, 3, device=DEVICE, requires_grad=True) for _ in range(2))
    numbers = {"tensor": there.uniforms((ROWS,), PATHS), "stream": Stream(3, PATHS)}
    for method in methods:
        form = CALLS[method]
        try:
            outputs = METHODS[method](there, wi, wo, numbers[form])
            total = torch.stack([x.sum() for x in outputs if x.requires_grad]).sum()
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


def metallic_roughness(quick: bool) -> Iterator[tuple[str, BSDF]]:
    """glTF's material: the plain one, and for a slow run every kind of it."""
    kinds: list[dict[str, Any]] = [{}]
    if not quick:
        kinds += [
            {"anisotropy": torch.tensor(0.5), "diffuse": "rough"},
            {"bounces": "one"},
            {"bounces": "one", "diffuse": "rough"},
            {"diffuse": "rough"},
        ]
    for words in kinds:
        yield f"metallic-roughness {words}", MetallicRoughness([0.5, 0.4, 0.3], 0.5, 0.5, **words)


def check_shading(surface: BSDF) -> list[str]:
    """World space: frames, roughness by name, values and samples."""
    r, a = (torch.rand(ROWS, device=DEVICE, requires_grad=True) for _ in range(2))
    x, y = alphas(r, a, "gltf", least=1e-3)
    given = {**leaves(surface), "distribution.alpha": x, "distribution.alpha_y": y}
    there = with_parameters(surface, given)
    normal, view, light, tangent = (torch.rand(ROWS, 3, device=DEVICE, requires_grad=True) for _ in range(4))
    words = {"tangent": tangent, "two_sided": True, "normalize": True}
    drawn = sample(there, normal, view, Stream(1, PATHS), **words)
    values = [
        shade(there, normal, view, light, Stream(1), cosine=False, **words),
        shade(there, normal, view, drawn.light, Stream(1), tangent=tangent),
        drawn.pdf,
        alpha(r, "pbrt-v3"),
    ]
    gradients = torch.autograd.grad([v.sum() for v in values], [r, a, normal, view, light, tangent])
    return [f"shading: a result on {v.device}" for v in (*values, *gradients) if v.device.type != DEVICE]


def check_dropins() -> list[str]:
    """What takes the place of other projects' functions, with all bounces and with one; its tables move by themselves."""
    found = []
    for bounces in ("all", 1):
        given = [torch.rand(ROWS, 3, device=DEVICE, requires_grad=True) for _ in range(6)]
        light = torch.rand(ROWS, PATHS, 3, device=DEVICE, requires_grad=True)
        r = torch.rand(ROWS, 1, device=DEVICE, requires_grad=True)
        maps = {"linear_albedo": 3, "roughness": 1, "metallic": 1, "normal": 3}
        material = SimpleNamespace(**{name: torch.rand(c, 2, ROWS, device=DEVICE) for name, c in maps.items()})
        material.device = torch.device(DEVICE)
        values = [
            GGX_specular(given[0], given[1], light, r, given[2], bounces=bounces),
            GGX_specular(given[0], given[1], light, 0.5, 0.04, bounces=bounces),
            pbr_bsdf(*given, bounces=bounces),
            *(
                CookTorranceBRDF(kind, bounces=bounces)(material, *(x[0] for x in given[:3]))
                for kind in ("point", "directional")
            ),
        ]
        gradients = torch.autograd.grad([v.sum() for v in values], [*given, light, r])
        found += [f"drop-ins: a result on {v.device}" for v in (*values, *gradients) if v.device.type != DEVICE]
    return found


def main(which: str) -> int:
    failures = []
    shared = bsdf("conductor[conductor]", "invariance", max_order=2, dtype=torch.float32)
    for sequence in SEQUENCES:  # the shared points hold real numbers, whoever asks for them
        Stream(1, PATHS, sequence).uniforms((1,), shared.n_uniforms)
    built = {
        names: bsdf(*names, alpha=alphas_for(*names[:2]), max_order=2, dtype=torch.float32)
        for names in models(which == "quick")
    }
    layered = list(metallic_roughness(which == "quick"))
    _setup_privateuseone_for_python_backend(DEVICE)
    torch._C._set_only_lift_cpu_tensors(True)
    with FakeTensorMode(allow_non_fake_inputs=True):
        try:
            _ = torch.rand(2, device=DEVICE) + torch.rand(2)
        except RuntimeError:
            pass
        else:
            failures.append("fake tensors of two devices can be added: nothing here means anything")
        failures += check_numbers(shared)
        failures += check_shading(built["conductor[conductor]", "single", "ggx"] if which == "quick" else shared)
        for name, surface in layered:
            failures += [f"{name}, {line}" for line in check(surface, CALLS)]
        failures += check_dropins()
        for names, surface in built.items():
            start = time.process_time()
            methods = CALLS if which == "slow" or names[1] in ("single", *APPROXIMATIONS) else OF_A_SCATTERING
            failures += [f"{'-'.join(names)}, {line}" for line in check(surface, methods)]
            print(f"{'-'.join(names)}: {time.process_time() - start:.2f} s", file=sys.stderr, flush=True)
    print(*failures, sep="\n")
    return int(bool(failures))


if __name__ == "__main__":
    status = main(sys.argv[1])
    sys.stdout.flush()
    # Autograd's threads of that device may outlive the interpreter, and abort the process when they ask for it again: a race
    # at its end, on a busy machine, which says nothing of what was checked.
    os._exit(status)
