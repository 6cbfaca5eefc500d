"""Input that nobody should give: a clear error, or what the documentation says, never a silent wrong number."""

import math
from collections.abc import Iterator

import pytest
import torch
from cases import COMPENSATIONS, METHODS, SCATTERINGS, bsdf, direction, directions, each, models
from torch import Tensor, nn

import torchms
from torchms import GGX, GTR, Beckmann, Correlated, RoughConductor, RoughDiffuse, SingleBounce, Stream, Unidirectional
from torchms.fresnel import Conductor, Dielectric, Ideal, Schlick
from torchms.lobes import measure
from torchms.testing import chi_square, chi_square_p_value, law_suite, reciprocity, sidak, white_furnace

pytestmark = pytest.mark.usefixtures("messages")
DRAWING = [name for name in METHODS if name != "pdf"]
SHORT = {"half": torch.float16, "bfloat16": torch.bfloat16}
EVERY = [*SCATTERINGS, *COMPENSATIONS]


@pytest.fixture
def unchecked() -> Iterator[None]:
    before = torchms.set_validation(False)
    yield
    torchms.set_validation(before)


def given(material: str, scattering: str, generator: torch.Generator, n: int = 4, dtype: torch.dtype = torch.float32):
    """A surface, directions and numbers for it."""
    surface = bsdf(material, scattering, alpha=(0.6,), max_order=2, dtype=dtype)
    wi, wo = (directions(n, generator, dtype=dtype) for _ in range(2))
    return surface, wi, wo, surface.uniforms((n,), 2, generator=generator)


# Precision.


@each("method", METHODS)
@each("short", SHORT)
def test_short_arguments_are_widened(method, short, generator, unchecked):
    """Directions and numbers of 16 bits give the bits of their float32 selves (which are not as near to unit vectors)."""
    surface, *arguments = given("conductor[conductor]", "height-walk", generator)
    arguments = [x.to(SHORT[short]) for x in arguments]
    for found, expected in zip(
        METHODS[method](surface, *arguments), METHODS[method](surface, *(x.float() for x in arguments)), strict=True
    ):
        assert found.dtype == expected.dtype != SHORT[short] and torch.equal(found, expected)


@each("short", SHORT)
def test_short_parameters(short, generator):
    """A tensor becomes float32 and keeps its graph; a module that was shortened says so when it is used."""
    alpha = torch.tensor(0.5, dtype=SHORT[short], requires_grad=True)
    surface, wi, wo, u = given("conductor[schlick]", "height-walk", generator)
    surface.distribution = GGX(alpha)
    assert surface.distribution.alpha.dtype == torch.float32
    surface(wi, wo, u).sum().backward()
    assert alpha.grad is not None and alpha.grad.isfinite()
    shortened = bsdf("conductor[schlick]", "height-walk", max_order=2).to(SHORT[short])
    for method in METHODS.values():
        with pytest.raises(
            TypeError, match=r"float32 or float64; \S+ of this RoughConductor is torch\..*bsdf\.float\(\)"
        ):
            method(shortened, wi, wo, u)


@models(["conductor[conductor]", "dielectric", "diffuse"], EVERY)
def test_autocast_shortens_nothing(material, scattering, generator):
    surface, *arguments = given(material, scattering, generator)
    for method in METHODS.values():
        plain = method(surface, *arguments)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            assert all(torch.equal(a, b) for a, b in zip(method(surface, *arguments), plain, strict=True))


def test_autocast_of_gtr(generator):
    facets, w, u = GTR(0.4, 1.5), directions(4, generator, dtype=torch.float32), torch.rand(4, 2, generator=generator)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = facets.sample_visible(w, u)
    assert torch.equal(found, facets.sample_visible(w, u))


# Random numbers.


@each("method", DRAWING)
@pytest.mark.parametrize("bad", [-1e-9, 1.5, math.nan, math.inf])
def test_numbers_outside_of_the_unit_interval(method, bad, generator):
    surface, wi, wo, u = given("dielectric", "height-walk", generator)
    u[2, 1, 3] = bad
    with pytest.raises(ValueError, match=r"u must hold numbers in \[0, 1\); got \S+ at index \(2, 1, 3\)\..*set_val"):
        METHODS[method](surface, wi, wo, u)


@models(["conductor[conductor]", "dielectric", "diffuse"], EVERY)
def test_a_number_that_was_rounded_to_1_does_no_harm(material, scattering, generator):
    """Values and gradients are finite."""
    surface, wi, wo, u = given(material, scattering, generator)
    u = torch.where(torch.rand(u.shape, generator=generator) < 0.5, 1.0, u)
    alpha = surface.distribution.get_buffer("alpha").requires_grad_()
    for method in METHODS.values():
        for part in method(surface, wi, wo, u):
            assert bool(part.isfinite().all())
            if part.requires_grad:
                assert bool(torch.autograd.grad(part.sum(), alpha, retain_graph=True)[0].isfinite())


@each("method", DRAWING)
def test_unchecked_numbers_harm_no_other_row(method, generator, unchecked):
    surface, wi, wo, u = given("dielectric", "height-walk", generator)
    spoilt = u.clone()
    spoilt[1] = math.nan
    others = torch.tensor([0, 2, 3])
    for good, bad in zip(METHODS[method](surface, wi, wo, u), METHODS[method](surface, wi, wo, spoilt), strict=True):
        assert torch.equal(good[others], bad[others])


# Directions that are nearly none, and modes of torch.


@models(["conductor[conductor]", "dielectric", "diffuse"], EVERY)
def test_negative_zeros_and_denormals(material, scattering, generator):
    """−0 is 0, to the bit; what is denormal is finite, and so are its gradients."""
    zeros = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8], [0.0, 0.0, -1.0]])
    surface, _, _, u = given(material, scattering, generator, len(zeros))
    negative = torch.where(zeros == 0, -0.0, zeros)
    tiny = torch.where(zeros == 0, 1e-42, zeros).requires_grad_()
    for method in METHODS.values():
        for a, b in zip(method(surface, zeros, zeros, u), method(surface, negative, negative, u), strict=True):
            assert torch.equal(a.abs(), b.abs())
        for part in method(surface, tiny, tiny.flip(0), u):
            assert bool(part.isfinite().all())
            if part.requires_grad:
                assert bool(torch.autograd.grad(part.sum(), tiny, retain_graph=True)[0].isfinite().all())


@each("mode", {"inference": torch.inference_mode, "no_grad": torch.no_grad})
def test_without_gradients_the_bits_are_the_same(mode, generator):
    surface, wi, wo, u = given("dielectric", "bidirectional-correlated", generator)
    alpha = surface.distribution.get_buffer("alpha").requires_grad_()
    plain = surface(wi, wo, u)
    with {"inference": torch.inference_mode, "no_grad": torch.no_grad}[mode]():
        quiet = surface(wi, wo, u)
    assert plain.requires_grad and not quiet.requires_grad and torch.equal(plain, quiet)
    assert bool(torch.autograd.grad(plain.sum(), alpha)[0].isfinite())


def test_another_default_dtype(generator):
    torch.set_default_dtype(torch.float64)
    try:
        surface = RoughConductor(GGX(0.5, 0.3), Schlick([0.2, 0.9]), Unidirectional(Correlated(), 2))
        wi, wo = directions(3, generator), directions(3, generator)
        value = surface(wi, wo, Stream(1, 2))
    finally:
        torch.set_default_dtype(torch.float32)
    assert value.dtype == torch.float64
    torch.testing.assert_close(surface(wi, wo, Stream(1, 2)), value)


# Other devices, layouts and kinds.


@each("method", METHODS)
def test_meta_tensors_have_shapes(method, generator):
    surface, *arguments = given("conductor[conductor]", "height-walk", generator)
    expected = METHODS[method](surface, *arguments)
    found = METHODS[method](surface.to("meta"), *(x.to("meta") for x in arguments))
    assert [x.shape for x in found] == [x.shape for x in expected] and "<()>" in repr(surface)
    with pytest.raises(ValueError, match=r"wi is on device cpu, \S+ of this RoughConductor on meta.*bsdf\.to\('cpu'\)"):
        METHODS[method](surface, *arguments)


UP, CONDUCTOR = torch.tensor([[0.0, 0.0, 1.0]]), RoughConductor(GGX(0.5), Ideal(), SingleBounce())
NAN = UP * math.nan
MANY = nn.functional.normalize(torch.arange(60.0).reshape(20, 3) + 1, dim=-1)


def uniform(w: Tensor) -> Tensor:
    return torch.full((len(w),), 0.25 / math.pi, dtype=w.dtype)


REFUSED = {
    "sparse": (lambda: CONDUCTOR.pdf(UP.to_sparse(), UP), TypeError, r"wi must be .*sparse_coo"),
    "array": (lambda: CONDUCTOR.pdf(UP.numpy(), UP), TypeError, r"wi must be .*got ndarray"),
    "D of a list": (lambda: GGX(0.5).D([0, 0, 1]), TypeError, r"floating-point Tensor.*got list"),
    "D of integers": (lambda: Beckmann(0.5).D(UP.long()), TypeError, r"floating-point Tensor.*torch\.int64"),
    "Λ of two": (lambda: GTR(0.5, 2.0).Lambda(torch.zeros(4, 2)), ValueError, r"\(\*batch, 3\).*\(4, 2\)"),
    "u of three": (lambda: GGX(0.5).sample_visible(UP, UP), ValueError, r"u must be \(\*batch, 2\).*\(1, 3\)"),
    "u of integers": (lambda: GGX(0.5).sample_visible(UP, UP.long()), TypeError, r"u must be .*torch\.int64"),
    "cosine a float": (lambda: Schlick(0.5)(0.5), TypeError, r"cos_theta must be a floating-point Tensor.*got float"),
    "cosine an integer": (lambda: Ideal()(torch.tensor(1)), TypeError, r"cos_theta must be .*torch\.int64"),
    "no f0": (lambda: Schlick(None), TypeError, r"Schlick\(f0=\.\.\.\) must be .*got None"),
    "no eta": (lambda: Dielectric(None), TypeError, r"Dielectric\(eta=\.\.\.\).*got None"),
    "no k": (lambda: Conductor(1.0, None), TypeError, r"Conductor\(k=\.\.\.\).*got None"),
    "no albedo": (lambda: RoughDiffuse(GGX(0.5), None), TypeError, r"albedo=\.\.\.\).*got None"),
    "no channel": (lambda: Schlick([]), ValueError, r"f0=\.\.\.\) must have at least one channel.*\(0,\)"),
    "no channel of albedo": (
        lambda: RoughDiffuse(GGX(0.5), torch.zeros(3, 0)),
        ValueError,
        r"albedo.*channel.*\(3, 0\)",
    ),
    "ragged": (lambda: Schlick([[0.1], [0.1, 0.2]]), TypeError, r"f0=\.\.\.\) must hold real numbers.*\[\[0\.1\]"),
    "words": (lambda: GGX(["rough"]), TypeError, r"GGX\(alpha=\.\.\.\) must be one number.*'rough'"),
    "complex channels": (
        lambda: Conductor([0.2 + 3j], 0.0),
        TypeError,
        r"Conductor\(eta=\.\.\.\) must hold real numbers",
    ),
    "batch a number": (lambda: CONDUCTOR.uniforms(4), TypeError, r"batch_shape must be a sequence of sizes.*got 4"),
    "batch a word": (lambda: CONDUCTOR.uniforms("4"), TypeError, r"batch_shape must be .*got '4'"),
    "batch below 0": (lambda: CONDUCTOR.uniforms((-1,)), ValueError, r"at least 0; got \(-1,\)"),
    "half a path": (lambda: CONDUCTOR.uniforms((1,), 1.5), TypeError, r"n_paths must be an int; got 1\.5"),
    "no path": (lambda: CONDUCTOR.uniforms((0,), 0), ValueError, r"n_paths must be at least 1; got 0"),
    "no path and no row": (lambda: CONDUCTOR.sample(UP[:0], torch.zeros(0, 0, 3)), ValueError, r"N >= 1.*\(0, 0, 3\)"),
    "a batch beyond counting": (
        lambda: CONDUCTOR.pdf(UP[0].expand(2**33, 1, 3), UP[0].expand(1, 2**33, 3)),
        ValueError,
        r"the batch \(8589934592, 8589934592\) has more than 2\^48 elements",
    ),
    "no bins": (lambda: chi_square(MANY, uniform, (0, 8)), ValueError, r"bins must be two positive integers.*\(0, 8\)"),
    "one bin axis": (
        lambda: chi_square(MANY, uniform, (8,)),
        ValueError,
        r"bins must be two positive integers.*\(8,\)",
    ),
    "no tolerance": (lambda: chi_square(MANY, uniform, (8, 8), 0.0), ValueError, r"tolerance must be positive; got 0"),
    "few directions": (lambda: chi_square(MANY[:3], uniform), ValueError, r"directions must be 10 at least.*got 3"),
    "a NaN among directions": (
        lambda: chi_square(torch.cat([MANY, NAN]), uniform),
        ValueError,
        r"directions must be unit vectors",
    ),
    "directions of two": (lambda: chi_square(MANY[:, :2], uniform), ValueError, r"directions must be \(\*batch, 3\)"),
    "a NaN of the density": (
        lambda: chi_square(MANY, lambda w: uniform(w) * math.nan, (4, 4)),
        ValueError,
        r"integrate to 1.*got nan",
    ),
    "a density of another shape": (
        lambda: chi_square(MANY, lambda w: uniform(w)[:, None], (4, 4)),
        ValueError,
        r"must give a Tensor \(n,\)",
    ),
    "counts of another sum": (
        lambda: chi_square_p_value(torch.ones(3), torch.ones(3) * 2),
        ValueError,
        r"same sum; got 3 and 6",
    ),
    "a furnace of a distribution": (
        lambda: white_furnace(GGX(0.5), UP, torch.rand(1, 4, 3)),
        TypeError,
        r"takes a BSDF.*GGX",
    ),
    "a furnace of one path": (
        lambda: white_furnace(CONDUCTOR, UP, torch.rand(1, 1, 3)),
        ValueError,
        r"at least 2 samples",
    ),
    "reciprocity of a distribution": (lambda: reciprocity(GGX(0.5), UP, UP), TypeError, r"takes a BSDF; got GGX"),
    "a level of 1": (lambda: sidak(1.0, 3), ValueError, r"level must lie in \(0, 1\); got 1"),
    "no tests": (lambda: sidak(0.01, 0), ValueError, r"tests must be at least 1; got 0"),
    "a suite of one sample": (lambda: law_suite(GGX(0.5), samples=1), ValueError, r"samples=.*at least 100; got 1"),
    "a suite's seed": (lambda: law_suite(GGX(0.5), seed=1.5), ValueError, r"seed=.*integer.*got 1\.5"),
    "a suite's level": (lambda: law_suite(GGX(0.5), level=0.0), ValueError, r"level=.*\(0, 1\); got 0"),
    "NaN, compiled": (lambda: torchms.compile(CONDUCTOR).pdf(NAN, UP), ValueError, r"wi must hold unit vectors"),
    "NaN, furnace": (
        lambda: white_furnace(CONDUCTOR, NAN, torch.rand(1, 4, 3)),
        ValueError,
        r"wi must hold unit vectors",
    ),
    "NaN, reciprocity": (lambda: reciprocity(CONDUCTOR, UP, NAN), ValueError, r"wo must hold unit vectors"),
    "NaN, measure": (lambda: measure(CONDUCTOR, NAN[0], n_paths=9, progress=False), ValueError, r"wi"),
}


@each("case", REFUSED)
def test_refused_with_name_and_value(case):
    call, error, message = REFUSED[case]
    with pytest.raises(error, match=r"(?s)" + message):
        call()


@each("term", {"ideal": Ideal(), "conductor": Conductor(0.2, 3.0), "glass": Dielectric(1.5), "schlick": Schlick(0.5)})
def test_a_cosine_that_is_nan_stays_one(term):
    fresnel = {"ideal": Ideal(), "conductor": Conductor(0.2, 3.0), "glass": Dielectric(1.5), "schlick": Schlick(0.5)}[
        term
    ]
    F = fresnel(torch.tensor([math.nan, 0.5]))
    assert bool(F[0].isnan().all()) and bool(F[1].isfinite().all())


def test_a_trained_parameter_of_16_bits_stays_one():
    """It is not replaced behind the optimizer's back; using it is refused."""
    alpha = nn.Parameter(torch.tensor(0.5, dtype=torch.float16))
    surface = RoughConductor(GGX(alpha), Ideal(), SingleBounce())
    assert surface.distribution.alpha is alpha
    w: Tensor = direction(0.5)
    with pytest.raises(TypeError, match=r"distribution\.alpha of this RoughConductor is torch\.float16"):
        surface.pdf(w, w)
