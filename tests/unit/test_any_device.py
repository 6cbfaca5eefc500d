"""Any torch device: nothing that a kernel makes stays on the CPU, forward or backward; see tests/any_device.py."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch
from cases import directions
from torch.utils._python_dispatch import TorchDispatchMode

from torchms import GGX, KullaConty, RoughConductor, Stream
from torchms.evaluation import arguments
from torchms.fresnel import Schlick
from torchms.maths.constants import constants

PROGRAM = Path(__file__).parent.parent / "any_device.py"


@pytest.mark.parametrize("which", ["quick", pytest.param("slow", marks=pytest.mark.slow)])
def test_on_a_fake_device(which):
    """In a process of its own, which has another device for good."""
    done = subprocess.run([sys.executable, PROGRAM, which], capture_output=True, text=True, timeout=1000, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]


class Reads(TorchDispatchMode):
    """Counts what the host reads of tensors."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        self.count += func is torch.ops.aten._local_scalar_dense.default
        return func(*args, **(kwargs or {}))


def test_values_off_the_cpu_are_read_once(generator, monkeypatch):
    """A batch of several blocks, with numbers; and what is wrong is still found, wherever it is."""
    wi, wo = directions(40_000, generator), directions(40_000, generator)
    u = torch.rand(40_000, 1, 3, generator=generator)
    monkeypatch.setattr(arguments, "_on_host", lambda x: False)
    with Reads() as reads:
        arguments.check_values(None, {"wi": wi, "wo": wo}, u)
    assert reads.count == 1
    for name, x, expected in (("wi", wi, "wi must hold"), ("wo", wo, "wo must hold"), ("u", u, "u must hold numbers")):
        spoilt = x.clone()
        spoilt[33_333] = torch.nan
        with pytest.raises(ValueError, match=rf"{expected}.*got nan at index \(33333"):
            arguments.check_values(
                None, {"wi": wi, "wo": wo, name: spoilt} if name != "u" else {"wi": wi}, u if name != "u" else spoilt
            )


def test_device_of_a_surface():
    """Where its tensors are, and where its random numbers are drawn unless it is said."""
    surface = RoughConductor(GGX(0.3), Schlick([0.5])).to("meta")
    assert surface.device.type == "meta" and surface.uniforms((3,)).device.type == "meta"
    assert surface.uniforms((3,), device="cpu").device.type == "cpu"
    assert RoughConductor(GGX(0.3), Schlick([0.5])).device.type == "cpu"
    assert Stream(1).uniforms((3,), 2, device="meta").device.type == "meta"


@pytest.mark.parametrize("sequence", ["random", "sobol"])
def test_a_generator_gives_the_same_numbers_wherever_they_are_wanted(sequence):
    surface = RoughConductor(GGX(0.3), Schlick([0.5]))
    ours, theirs = (
        surface.uniforms((3,), generator=torch.Generator().manual_seed(2), sequence=sequence, **where)
        for where in ({}, {"device": "cpu"})
    )
    assert torch.equal(ours, theirs)


def test_constants_are_made_once():
    """Also where the first call was one whose tensors know no gradient."""
    like = torch.zeros(2, dtype=torch.float64)
    with torch.inference_mode():
        first = constants((1.0, 2.5, -3.0), like)
    assert first is constants((1.0, 2.5, -3.0), like) and first.tolist() == [1.0, 2.5, -3.0]
    assert constants((1.0, 2.5, -3.0), like.float()).dtype == torch.float32
    x = torch.ones(3, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad((first * x).sum(), x)
    assert torch.equal(gradient, first)


def test_a_mean_reflectance_after_inference():
    """What an inference mode made first serves a training step later."""
    wi = torch.tensor([0.6, 0.0, 0.8])
    f0 = torch.tensor([0.31, 0.62], requires_grad=True)
    with torch.inference_mode():
        RoughConductor(GGX(0.3), Schlick([0.5]), KullaConty())(wi, wi)
    value = RoughConductor(GGX(0.3), Schlick(f0), KullaConty())(wi, wi)
    assert bool((torch.autograd.grad(value.sum(), f0)[0] > 0).all())
