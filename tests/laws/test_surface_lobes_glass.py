"""Lobes of one surface of glass, whatever was learned: reciprocal, positive, walks that carry them, gradients, refusals."""

import math
from pathlib import Path

import pytest
import torch
from cases import direction, directions
from test_energy import agreement
from torch import Tensor

import torchms
from torchms import Beckmann, Distilled, RoughConductor, RoughDielectric, Tabulated
from torchms.approximations import distilled_file as files
from torchms.approximations.distil.glass_fit import inputs_of
from torchms.approximations.distil.glass_rows import Surfaces
from torchms.approximations.free_glass_features import FREE
from torchms.approximations.surface_correction import ORDERS
from torchms.fresnel import Dielectric, Ideal
from torchms.microsurface.distil import glass
from torchms.microsurface.distil.networks import Correction
from torchms.testing import reciprocity

ETA = 1.5
SLOPES = Tabulated([0.6, 0.4], [[0.2, 0.1], [-0.3, -0.15]], [[[0.1, 0.02], [0.02, 0.05]], [[0.03, 0.0], [0.0, 0.06]]])
"""Not its own mirror image, nor round."""


def random_rows(n: int, generator: torch.Generator) -> tuple[Surfaces, Tensor]:
    """Light from outside and from inside, each seen from its own side, and directions above."""
    ax, ay = (float(alpha) * torch.ones(n) for alpha in SLOPES.alphas)
    eta = torch.where(torch.arange(n) % 2 == 0, ETA, 1 / ETA)
    wi, wo = (directions(n, generator, 0.02, torch.float32) for _ in range(2))
    return Surfaces(ax, ay, eta, wi), wo


class Learned:
    """Corrections of random numbers, and the file that holds them."""

    def __init__(self, generator: torch.Generator) -> None:
        self.where, self.wo = random_rows(200, generator)
        self.parts = []
        for out in self.sides():
            inputs, _ = inputs_of("Beckmann", self.where, out, bool(out[0, 2] > 0), features=FREE)
            model = Correction((6, 5), (4,), inputs)
            vector = model.initial(generator)
            self.parts.append((model, vector + 0.1 * torch.randn(len(vector), generator=generator), inputs))
        (layers, skip), each = (found := [model.folded(vector) for model, vector, _ in self.parts])[0]
        low, high = sorted(float(alpha) for alpha in SLOPES.alphas)
        self.file = files.Distillate(
            "scan_glass",
            "Tabulated",
            (0.9 * low, 1.1 * high),
            *(layers, skip, {}, each, glass.base(), SLOPES.mixture),
            through=found[1],
            eta=(ETA, ETA),
        )

    def sides(self) -> tuple[Tensor, Tensor]:
        """Directions reflected, and transmitted."""
        return self.wo, self.wo * torch.tensor([1.0, 1.0, -1.0])


@pytest.fixture
def learned(generator) -> Learned:
    """What was learned of such a surface."""
    return Learned(generator)


@pytest.fixture
def model(learned, tmp_path: Path) -> Distilled:
    """The same, written and read."""
    files.write(tmp_path / "glass.npz", learned.file)
    return Distilled(tmp_path / "glass.npz")


def surface(model: Distilled, mode: str = "radiance") -> RoughDielectric:
    """In double precision."""
    return RoughDielectric(model.slopes, Dielectric(ETA), model, mode).double()


def test_what_was_learned_is_what_runs(learned, model):
    """Smith's lobes of each order, reflected and transmitted from either side, times the corrections of the vectors."""
    outside = RoughDielectric(model.slopes, Dielectric(ETA), model, "importance")
    side = torch.where(learned.where.eta > 1, 1.0, -1.0)[:, None]
    for (correction, vector, inputs), wo in zip(learned.parts, learned.sides(), strict=True):
        expected = glass.smith_glass(learned.where, wo, model.slopes)
        expected = expected * torch.exp(correction.outputs(vector, correction.standardised(inputs)))
        found = outside.orders(side * learned.where.wi, side * wo)[..., 0]
        assert found.shape == (200, ORDERS) and (found[:, 1:] > 0).all() and (found >= 0).all()
        torch.testing.assert_close(found, expected, rtol=5e-3, atol=1e-7)


@pytest.mark.parametrize("mode", ["radiance", "importance"])
def test_exchanged_directions(model, mode, generator):
    """f n_i² is the same both ways, to rounding, from either side and through the surface."""
    wi, wo = directions(300, generator), directions(300, generator)
    there, back = reciprocity(surface(model, mode), wi, wo)
    torch.testing.assert_close(there.mean, back.mean, rtol=1e-9, atol=1e-15)
    assert (there.mean[:, 1:] > 0).all()


@pytest.mark.parametrize("side", [1, -1])
def test_walks_carry_the_lobes(model, side, generator, seed, budget):
    """∫ orders = sample_walk = albedo, by order and side; and cell by cell, for the walks."""
    budget(agreement(surface(model, "importance"), side * direction(0.8), 30_000, generator, seed))


def test_gradients_are_exact(model, generator):
    """d orders / d (slopes, directions), from both sides: gradcheck in float64."""
    wi, wo = (torch.cat([directions(1, generator, 0.2), -directions(1, generator, 0.2)]) for _ in range(2))
    wi, wo = torch.cat([wi, wi]), torch.cat([wo, -wo])
    scale = torch.tensor(1.001, dtype=torch.float64)
    weights, means, covariances = (torch.as_tensor(x) for x in SLOPES.mixture)
    model = model.double()

    def orders(scale: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        unit = [torch.nn.functional.normalize(w, dim=-1) for w in (wi, wo)]
        slopes = Tabulated(weights, means, covariances, scale).double()
        return RoughDielectric(slopes, Dielectric(ETA), model).orders(*unit)

    start = [x.requires_grad_() for x in (scale, wi, wo)]
    assert torch.autograd.gradcheck(orders, start, eps=1e-6, atol=1e-6, rtol=1e-4)


def test_edges_are_finite(model):
    """Pole, horizon, and one direction twice: values and gradients."""
    glancing = math.pi / 2 - 1e-7
    edges = torch.stack([direction(t, p) for t in (0.0, 0.5, glancing, math.pi / 2) for p in (0.0, 2.0)])
    edges = torch.cat([edges, -edges])
    wi, wo = (x.reshape(-1, 3).requires_grad_() for x in torch.broadcast_tensors(edges[:, None], edges[None]))
    values = surface(model).orders(wi, wo)
    assert torch.isfinite(values).all() and (values >= 0).all()
    slopes = torch.autograd.grad(values.sum(), (wi, wo))
    assert all(torch.isfinite(slope).all() for slope in slopes)


@pytest.mark.usefixtures("messages")
def test_what_it_is_not_about_is_refused(learned, model, tmp_path: Path):
    """Another index, other slopes, metal, a rougher surface, and files without or with a wrong range of the index."""
    for make in (
        lambda: RoughDielectric(model.slopes, Dielectric(1.4), model),
        lambda: RoughDielectric(model.slopes, Dielectric(1 / ETA), model),
        lambda: RoughDielectric(Beckmann(0.5), Dielectric(ETA), model),
        lambda: RoughConductor(model.slopes, Ideal(), model),
        lambda: RoughDielectric(Tabulated(*SLOPES.mixture, 1.5), Dielectric(ETA), model),
    ):
        with pytest.raises(ValueError, match=r"Distilled"):
            make()
    with pytest.raises(ValueError, match=r"must be 1.5.*torchms distil"):
        RoughDielectric(model.slopes, Dielectric(1.4), model)
    files.write(tmp_path / "range.npz", learned.file._replace(eta=(2.0, 1.0)))
    with pytest.raises(ValueError, match=r"no range"):
        Distilled(tmp_path / "range.npz")
    files.write(tmp_path / "without.npz", learned.file._replace(eta=None))
    with pytest.raises(ValueError, match=r"layers"):
        Distilled(tmp_path / "without.npz")


@pytest.mark.slow
@pytest.mark.usefixtures("messages")
def test_files_and_machine_code_are_eager(model, generator, tmp_path: Path):
    """Light from both sides, reflected and transmitted. The exporter traces what the checks of types would wrap."""
    runtime = pytest.importorskip("onnxruntime", reason="needs the onnx extra: pip install torchms[onnx]")
    eager = RoughDielectric(model.slopes, Dielectric(ETA), model)
    wi, wo = (torch.nn.functional.normalize(torch.randn(200, 3, generator=generator), dim=-1) for _ in range(2))
    expected = eager(wi, wo)
    torch.testing.assert_close(torchms.compile(eager, verbose=False)(wi, wo), expected, rtol=1e-4, atol=1e-5)
    file = torchms.onnx.export(eager, tmp_path / "glass.onnx")
    (found,) = runtime.InferenceSession(file).run(None, {"wi": wi.numpy(), "wo": wo.numpy()})
    torch.testing.assert_close(torch.from_numpy(found), expected, rtol=1e-5, atol=1e-5)
