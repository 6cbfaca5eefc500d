"""Fresnel terms against complex arithmetic, at the edges of the angle, and on batches."""

import math

import pytest
import torch
from torch import Tensor, nn

from torchms.fresnel import Conductor, Dielectric, Fresnel, Ideal, Schlick
from torchms.fresnel.conductor import fresnel_conductor
from torchms.fresnel.dielectric import fresnel_dielectric
from torchms.parameters.exchange import with_parameters

F64 = torch.float64
INDICES = [
    (0.05, 4.0),
    (0.2, 3.4),
    (1.0, 1.0),
    (1.5, 0.0),
    (0.6, 0.0),
    (1.3, 7.5),
    (3.5, 2.8),
    (12.0, 0.1),
    (0.9, 1e-3),
]
ETAS = [1e-3, 0.3, 1 / 1.5, 0.999, 1.001, 1.33, 1.5, 2.4, 50.0]


def models() -> dict[str, Fresnel]:
    return {
        "ideal": Ideal(),
        "conductor": Conductor([0.2, 0.9, 1.2], [3.9, 2.5, 2.2]),
        "conductor, k = 0": Conductor(1.5, 0.0),
        "conductor, eta = k = 1": Conductor(1.0, 1.0),
        "conductor, no boundary": Conductor(1.0, 0.0),
        "dielectric": Dielectric(1.5),
        "dielectric, inverted": Dielectric(1 / 1.5),
        "dielectric, no boundary": Dielectric(1.0),
        "schlick": Schlick([0.04, 0.5, 1.0]),
    }


each_model = pytest.mark.parametrize("name", models())


def cosines(n: int = 401, start: float = 0.0) -> Tensor:
    """Uniform over [start, 1], and crowded at both ends."""
    t = torch.linspace(0, 1, n, dtype=F64)
    small = torch.logspace(-9, -1, 81, dtype=F64)
    return torch.cat([start + (1 - start) * t, start + small, 1 - small])


def complex_fresnel(cos_i: Tensor, index: Tensor) -> Tensor:
    """Textbook amplitudes in complex arithmetic, no rearrangement."""
    index = index.to(torch.complex128)
    c = cos_i.to(torch.complex128)
    cos_t = torch.sqrt(1 - (1 - c * c) / (index * index))
    r_s = (c - index * cos_t) / (c + index * cos_t)
    r_p = (index * c - cos_t) / (index * c + cos_t)
    return (r_s.abs() ** 2 + r_p.abs() ** 2) / 2


@pytest.mark.parametrize("eta,k", INDICES)
def test_conductor_is_the_complex_formula(eta, k):
    c = cosines()
    F = Conductor(torch.tensor([eta], dtype=F64), torch.tensor([k], dtype=F64))(c)
    if k == 0 and eta < 1:  # the square root at the critical angle amplifies the reference's rounding
        c_critical = math.sqrt(1 - eta * eta)
        away = (c - c_critical).abs() > 1e-3
        F, c = F[away], c[away]
    torch.testing.assert_close(
        F[..., 0], complex_fresnel(c, torch.tensor(complex(eta, k), dtype=torch.complex128)), rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("eta,k", INDICES)
def test_conductor_in_float32_loses_few_digits(eta, k):
    eta32, k32 = torch.tensor([eta]), torch.tensor([k])
    c = cosines().float()
    reference = fresnel_conductor(c.double(), eta32.double(), k32.double())
    error = (fresnel_conductor(c, eta32, k32).double() - reference).abs()
    if k == 0 and eta < 1:
        away = (c - math.sqrt(1 - eta * eta)).abs() > 1e-3
        error, reference = error[away], reference[away]
    assert error.max() < 2e-6
    # What a mirror loses matters in multiple bounces: 1 − F keeps its relative accuracy to one rounding of F.
    assert (error / (1 - reference).clamp_min(0.01)).max() < 5e-5


def test_conductor_without_absorption_is_the_dielectric():
    c = cosines()
    for eta in ETAS:
        if eta > 1:
            n = torch.tensor(eta, dtype=F64)
            torch.testing.assert_close(
                fresnel_conductor(c, n, torch.zeros((), dtype=F64)), fresnel_dielectric(c, n)[0], rtol=1e-11, atol=1e-14
            )


@pytest.mark.parametrize("eta", ETAS)
def test_dielectric_is_the_complex_formula_and_snell(eta):
    c = cosines()
    n = torch.tensor(eta, dtype=F64)
    F, cos_t = fresnel_dielectric(c, n)
    sin2_t = (1 - c) * (1 + c) / eta**2
    total = sin2_t >= 1
    assert (F[total] == 1).all() and (cos_t[total] == 0).all()
    away = (sin2_t - 1).abs() > 1e-3 if eta < 1 else torch.ones_like(total)
    torch.testing.assert_close(F[away], complex_fresnel(c, n)[away], rtol=1e-12, atol=2e-12)
    torch.testing.assert_close(cos_t[~total] ** 2, 1 - sin2_t[~total], rtol=1e-12, atol=1e-12)
    assert F.max() <= 1 + 4 * torch.finfo(F64).eps and F.min() >= 0


@pytest.mark.parametrize("eta", ETAS)
def test_dielectric_in_float32_loses_few_digits(eta):
    n = torch.tensor(eta)
    c = cosines().float()
    F, cos_t = fresnel_dielectric(c, n)
    F64_, cos_t64 = fresnel_dielectric(c.double(), n.double())
    away = (c.double() ** 2 - (1 - n.double() ** 2)).abs() > 1e-3 if eta < 0.9 else torch.ones_like(c, dtype=torch.bool)
    # Near the critical angle the result is as sensitive as its square root; elsewhere nothing is lost.
    atol = 2e-6 if eta != 0.999 else 3e-3
    torch.testing.assert_close(F.double()[away], F64_[away], rtol=0, atol=atol)
    if eta > 1:
        torch.testing.assert_close(F.double(), F64_, rtol=3e-5, atol=1e-12)  # relative, so for 1.001 and Brewster too
        torch.testing.assert_close(cos_t.double(), cos_t64, rtol=1e-6, atol=1e-7)


def test_brewster_angle_reflects_half_of_s_and_nothing_of_p():
    for eta in (1.33, 1.5, 2.4):
        c = torch.tensor(1 / math.sqrt(1 + eta**2), dtype=F64)
        F, cos_t = fresnel_dielectric(c, torch.tensor(eta, dtype=F64))
        r_s = (1 - eta**2) / (1 + eta**2)
        assert F.item() == pytest.approx(r_s**2 / 2, rel=1e-13)
        assert cos_t.item() == pytest.approx(eta / math.sqrt(1 + eta**2), rel=1e-13)


@pytest.mark.parametrize("eta", [1e-3, 0.5, 1 / 1.5, 1.33, 1.5, 4.0, 1e6])
def test_dielectric_at_normal_incidence(eta):
    expected = ((eta - 1) / (eta + 1)) ** 2
    for dtype, rel in ((torch.float32, 1e-5), (F64, 1e-12)):
        F = Dielectric(torch.tensor(eta, dtype=dtype))(torch.tensor([1.0, -1.0], dtype=dtype))
        assert F[:, 0].tolist() == pytest.approx([expected, expected], rel=rel)


@pytest.mark.parametrize("eta", [1.0001, 1.33, 1.5, 2.4])
def test_dielectric_is_reciprocal_across_the_boundary(eta):
    model = Dielectric(torch.tensor(eta, dtype=F64))
    c = cosines(start=0.01)
    _, cos_t = fresnel_dielectric(c, model.eta)
    torch.testing.assert_close(model(c), model(-cos_t), rtol=1e-9, atol=1e-12)


def test_total_internal_reflection_starts_at_the_critical_angle():
    model = Dielectric(torch.tensor(1.5, dtype=F64))
    critical = math.sqrt(1 - 1 / 1.5**2)
    c = torch.tensor([critical - 1e-6, critical + 1e-6], dtype=F64, requires_grad=True)
    F = model(-c)[:, 0]
    assert F[0] == 1 and 0.98 < F[1] < 1
    (slope,) = torch.autograd.grad(F.sum(), c)
    assert slope[0] == 0 and torch.isfinite(slope[1]) and slope[1] < -100


def test_equal_indices_reflect_nothing_at_any_angle():
    for dtype in (torch.float32, F64):
        c = cosines().to(dtype)
        assert Conductor(torch.ones(1, dtype=dtype), torch.zeros(1, dtype=dtype))(c[c.sub(1e-7) * c >= 0]).max() < 1e-6
        c = torch.cat([c, torch.tensor([1e-30, 1e-12], dtype=dtype)])
        assert (Dielectric(torch.tensor(1.0, dtype=dtype))(torch.cat([c, -c])) == 0).all()


def test_schlick_and_ideal_are_their_formulas():
    c = cosines()
    f0 = torch.tensor([0.0, 0.04, 1.0], dtype=F64)
    torch.testing.assert_close(Schlick(f0)(-c), f0 + (1 - f0) * (1 - c[:, None]) ** 5, rtol=1e-13, atol=1e-15)
    assert torch.equal(Ideal()(c), torch.ones(*c.shape, 1, dtype=F64))


@pytest.mark.parametrize("model", [Conductor(0.2, 3.0), Schlick(0.5), Ideal()], ids=lambda m: type(m).__name__)
def test_side_does_not_matter_for_opaque_facets(model):
    c = cosines().float()
    assert torch.equal(model(c), model(-c))


@each_model
@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_value_and_gradient_are_finite_at_the_edges(name, dtype):
    model = models()[name].to(dtype)
    for key, value in list(model.named_buffers()):
        delattr(model, key)
        model.register_parameter(key, nn.Parameter(value.clone()))
    eps = torch.finfo(dtype).eps
    tiny = torch.finfo(dtype).tiny
    edges = [0.0, -0.0, tiny, 1e-20, eps, 1e-3, 0.5, 1 - eps, 1.0, 1 + eps, 1 + 4 * eps]
    c = torch.tensor([s * e for e in edges for s in (1, -1)], dtype=dtype, requires_grad=True)
    F = model(c)
    assert F.dtype == dtype and torch.isfinite(F).all()
    assert F.min() >= -4 * eps and F.max() <= 1 + 8 * eps
    if not F.requires_grad:
        assert isinstance(model, Ideal)
        return
    for one in F.reshape(-1):  # each alone: a sum could hide inf − inf
        for gradient in torch.autograd.grad(one, [c, *model.parameters()], retain_graph=True):
            assert torch.isfinite(gradient).all()


@pytest.mark.parametrize("side", [1, -1])
def test_gradients_of_the_dielectric(side):
    c = side * torch.tensor([1e-3, 0.2, 0.6, 0.9, 1 - 1e-4], dtype=F64)
    eta = torch.tensor([[1.5], [1.01], [1 / 1.3]], dtype=F64)
    assert torch.autograd.gradcheck(
        lambda c, eta: Dielectric(eta)(c), (c.requires_grad_(), eta.requires_grad_()), atol=1e-6, rtol=1e-5
    )


def test_gradients_of_conductor_and_schlick():
    c = torch.tensor([1e-3, 0.3, -0.7, 1 - 1e-4, 1.0], dtype=F64, requires_grad=True)
    eta = torch.tensor([0.2, 1.0, 2.3, 1.5], dtype=F64, requires_grad=True)
    k = torch.tensor([3.9, 1.0, 2.2, 0.1], dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda c, eta, k: Conductor(eta, k)(c), (c, eta, k), atol=1e-6, rtol=1e-5)
    f0 = torch.tensor([0.04, 0.5, 0.99], dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda c, f0: Schlick(f0)(c), (c, f0))


def test_gradient_at_grazing_is_the_one_from_the_front():
    for model in (Dielectric(1.5).double(), Conductor(0.2, 3.0).double(), Schlick(0.5).double()):
        c = torch.tensor([0.0, 1e-9], dtype=F64, requires_grad=True)
        slope = torch.autograd.grad(model(c).sum(), c)[0]
        assert slope[0] < 0 and slope[0].item() == pytest.approx(slope[1].item(), rel=1e-6)


@pytest.mark.parametrize("channels", [1, 3, 31])
def test_channels_stay_last(channels):
    values = torch.linspace(0.1, 0.9, channels)
    c = torch.rand(5, 4)
    for model in (Conductor(values, 2 + values), Conductor(0.5, values), Conductor(values, 3.0), Schlick(values)):
        F = model(c)
        assert F.shape == (5, 4, channels) and model.n_channels == channels
        assert torch.equal(model.reflectance(c), F.movedim(-1, 0))
        for i in range(channels):
            single = (
                Schlick(values[i])
                if isinstance(model, Schlick)
                else Conductor(model.eta.expand(channels)[i], model.k.expand(channels)[i])
            )
            torch.testing.assert_close(F[..., i : i + 1], single(c))
    for model in (Ideal(), Dielectric(1.5)):
        assert model(c).shape == (5, 4, 1) and model.n_channels == 1
    assert Schlick(0.5)(torch.tensor(0.3)).shape == (1,)


def test_parameters_of_a_pixel_meet_that_pixel_on_every_path():
    height, width, paths = 2, 3, 5
    c = torch.rand(paths, height, width, dtype=F64)
    eta, k = torch.rand(2, height, width, 4, dtype=F64).unbind(0)
    signed = 2 * c - 1
    F = Conductor(eta + 0.1, k)(c)
    G = Dielectric(eta[..., 0] + 0.5)(signed)
    H = Schlick(k)(c)
    assert F.shape == H.shape == (paths, height, width, 4) and G.shape == (paths, height, width, 1)
    for y in range(height):
        for x in range(width):
            torch.testing.assert_close(F[:, y, x], Conductor(eta[y, x] + 0.1, k[y, x])(c[:, y, x]))
            torch.testing.assert_close(G[:, y, x], Dielectric(eta[y, x, 0] + 0.5)(signed[:, y, x]))
            torch.testing.assert_close(H[:, y, x], Schlick(k[y, x])(c[:, y, x]))
    # One channel everywhere and a map of another parameter broadcast too.
    torch.testing.assert_close(Conductor(0.5, k)(c), Conductor(torch.full_like(k, 0.5), k)(c))
    rows = with_parameters(Conductor(eta + 0.1, k), {"eta": eta[:1] + 0.1, "k": k[:1]})
    torch.testing.assert_close(rows(c[:, :1]), F[:, :1])


def test_a_parameter_stays_one_and_a_map_keeps_its_graph():
    model = Conductor(nn.Parameter(torch.tensor([0.2, 0.9, 1.2])), torch.tensor([3.9, 2.5, 2.2]))
    assert [name for name, _ in model.named_parameters()] == ["eta"]
    assert [name for name, _ in model.named_buffers()] == ["k"]
    assert [name for name, _ in Dielectric(nn.Parameter(torch.tensor(1.5))).named_parameters()] == ["eta"]
    assert [name for name, _ in Schlick(nn.Parameter(torch.tensor(0.5).reshape(1))).named_parameters()] == ["f0"]
    latent = torch.zeros(4, 3, requires_grad=True)
    Schlick(torch.sigmoid(latent))(torch.rand(4)).sum().backward()
    assert latent.grad is not None and (latent.grad > 0).all()


@pytest.mark.parametrize(
    "build, message",
    [
        (
            lambda: Conductor(0.0, 1.0),
            r"Conductor\(eta=\.\.\.\) must lie in \(0, 1e\+06\]; got 0 at index \(0,\)\. Cond",
        ),
        (lambda: Conductor([1.0, 2.0, -3.0], 1.0), r"eta=.*got -3 at index \(2,\)"),
        (lambda: Conductor(float("nan"), 1.0), r"eta=.*got nan"),
        (lambda: Conductor(1.0, -0.1), r"Conductor\(k=\.\.\.\) must lie in \[0, 1e\+06\]; got -0\.1"),
        (lambda: Conductor(1.0, float("inf")), r"k=.*got inf"),
        (lambda: Conductor([1.0, 2.0], [1.0, 2.0, 3.0]), r"must broadcast; got shapes \(2,\) and \(3,\)"),
        (lambda: Dielectric(0.0), r"Dielectric\(eta=\.\.\.\) must lie in \[1e-06, 1e\+06\]; got 0\. It is n_inside"),
        (lambda: Dielectric(torch.tensor([1.5, -1.5])), r"got -1\.5 at index \(1,\)"),
        (lambda: Dielectric(float("nan")), r"got nan"),
        (lambda: Schlick(1.5), r"Schlick\(f0=\.\.\.\) must lie in \[0, 1\]; got 1\.5"),
        (lambda: Schlick([0.5, -0.1]), r"got -0\.1 at index \(1,\)"),
    ],
)
def test_bad_input_says_what_is_wrong(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_fresnel_is_abstract_and_a_model_describes_itself():
    with pytest.raises(TypeError, match="abstract"):
        Fresnel()  # pyright: ignore[reportAbstractUsage]  # refused
    assert repr(Dielectric(1.5)) == "Dielectric(eta=1.5)"
    assert repr(Conductor(1, 2)) == "Conductor(eta=[1.0], k=[2.0])"
    assert repr(Ideal()) == "Ideal()"
