"""glTF's material: white, reciprocal, its own formula with one bounce, and the maps that it takes."""

import itertools
import math
from typing import Any

import numpy as np
import onnxruntime
import pytest
import torch
from cases import direction, directions, each
from torch import Tensor

import torchms
from torchms import GGX, MetallicRoughness, RoughConductor, SingleBounce
from torchms.approximations.layered import Whitened, fingerprint
from torchms.approximations.layered_table import SHAPES, LayeredTable
from torchms.approximations.single_bounce_energy import energy as quadrature
from torchms.fresnel import Schlick
from torchms.parameters.exchange import parameters
from torchms.testing import law_suite

KINDS: dict[str, dict[str, Any]] = {
    "lambert": {},
    "rough": {"diffuse": "rough"},
    "one bounce": {"bounces": "one"},
    "rough, one bounce": {"diffuse": "rough", "bounces": "one"},
    "anisotropic": {"anisotropy": 0.6},
}
THETAS = (0.0, 0.4, 0.9, 1.3, 1.5)
POINTS = 1 << 12


def integrals(surface: MetallicRoughness, wi: Tensor) -> Tensor:
    """∫ f |cos θ_o| dwo, (len(wi), C), of what `forward` gives."""
    drawn = surface.sample(
        wi, surface.uniforms((), POINTS, sequence="sobol", generator=torch.Generator().manual_seed(1))
    )
    return (surface(wi, drawn) / drawn.pdf[..., None]).nan_to_num(0.0).mean(-2)


@each("diffuse", ["lambert", "rough"])
@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
def test_the_furnace_is_white(diffuse, metallic):
    """To 2e-3 and what the points miss, for any mix and any roughness that lobes were learned for."""
    wi = torch.stack([direction(t) for t in THETAS])
    for roughness in (0.2, 0.4, 0.7, 1.0):
        surface = MetallicRoughness([1.0], metallic, roughness, diffuse=diffuse).double()
        assert surface.is_lossless
        error = (integrals(surface, wi) - 1).abs()
        assert float(error[:-1].max()) < 2e-3 + 1e-3, f"roughness {roughness}: {error.squeeze()}"
        assert float(error[-1].max()) < 1e-2


@pytest.mark.slow
def test_the_furnace_is_white_in_the_table():
    """Everywhere: energies of the table, which `test_energies_are_integrals` compares with the values."""
    r = torch.linspace(0.174, 1, 60, dtype=torch.float64)[:, None]
    wi = torch.stack([direction(t) for t in torch.linspace(0, 1.55, 40).tolist()])
    for metallic, ior in itertools.product((0.0, 0.3, 1.0), (1.0, 1.5, 2.5)):
        surface = MetallicRoughness([1.0], metallic, r, ior=ior).double()
        energy = surface.albedo(wi).reflected.sum(-2)[..., 0]
        assert float((energy - 1).abs().max()) < 2e-3, (
            f"metallic {metallic}, ior {ior}: {float((energy - 1).abs().max())}"
        )


def test_smooth_surfaces_are_white_but_for_grazing_light():
    """Below α = 0.03, where there are no lobes: up to 80 degrees."""
    wi = torch.stack([direction(t) for t in (0.0, 0.7, 1.2, 1.4)])
    for roughness, metallic in itertools.product((0.0, 0.08, 0.12), (0.0, 1.0)):
        surface = MetallicRoughness([1.0], metallic, roughness).double()
        assert float((integrals(surface, wi) - 1).abs().max()) < 6e-3


@each("roughness", [0.05, 0.08, 0.1, 0.15])
def test_a_smooth_metal_is_white_at_grazing_light(roughness):
    """N·V = 0.15 to 0.05: one bounce by quadrature, and what bounces again along the samples of a rougher metal."""
    alpha = roughness**2
    wi = torch.stack([direction(math.acos(c)) for c in (0.15, 0.1, 0.07, 0.05)])
    alphas = torch.full((len(wi),), alpha, dtype=torch.float64)
    one = quadrature(GGX, wi, alphas, alphas, 112, 32)
    wider = MetallicRoughness([1.0], 1.0, 0.2).double()
    drawn = wider.sample(
        wi, wider.uniforms((), 8 * POINTS, sequence="sobol", generator=torch.Generator().manual_seed(1))
    )
    again = MetallicRoughness([1.0], 1.0, roughness).double().orders(wi, drawn)[..., 1:, 0].sum(-1)
    assert float((one + (again / drawn.pdf).nan_to_num(0.0).mean(-1) - 1).abs().max()) < 3e-3


@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_an_anisotropic_furnace_is_nearly_white(metallic):
    wi = torch.stack([direction(t, phi) for t in (0.4, 1.2) for phi in (0.0, 0.8, 1.5)])
    surface = MetallicRoughness([1.0], metallic, 0.6, anisotropy=0.6).double()
    assert float((integrals(surface, wi) - 1).abs().max()) < 5e-3


@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
def test_energies_are_integrals(metallic):
    """What `albedo` reads from the table is what `forward` adds up to, coloured and order by order."""
    wi = torch.stack([direction(t) for t in THETAS[:-1]])
    surface = MetallicRoughness([0.9, 0.5, 0.1], metallic, 0.6).double()
    drawn = surface.sample(
        wi, surface.uniforms((), POINTS, sequence="sobol", generator=torch.Generator().manual_seed(1))
    )
    orders = (surface.orders(wi, drawn) / drawn.pdf[..., None, None]).nan_to_num(0.0).mean(1)
    energy = surface.albedo(wi)
    assert energy.reflected.shape == (4, 5, 3) and not bool(energy.transmitted.any())
    torch.testing.assert_close(energy.reflected, orders, rtol=0, atol=2e-3)
    below = surface.albedo(-wi).reflected
    assert not bool(below.any())


def test_colours_saturate_and_do_not_gain():
    """Less than the base colour of what gets through, equal to it for white; a rough metal is darker and more coloured."""
    wi = direction(0.5)
    color = torch.tensor([0.2, 0.5, 0.8, 1.0], dtype=torch.float64)
    paint = MetallicRoughness(color, 0.0, 0.8).double().albedo(wi).reflected
    through = 1 - paint[:-1].sum(0)
    share = paint[-1] / through
    assert bool((share[:-1] < color[:-1]).all()) and bool((share[:-1] > 0.8 * color[:-1]).all())
    assert float(share[-1]) == pytest.approx(1.0, abs=2e-3)
    metal = [MetallicRoughness(color, 1.0, r).double().albedo(wi).reflected.sum(0) for r in (0.3, 1.0)]
    assert bool((metal[1] / color < metal[0] / color)[:-1].all())


@each("kind", KINDS)
def test_a_mix_is_that_of_its_facets(kind):
    """One bounce off facets is that of the lerped F0, and metal has no base."""
    words = KINDS[kind]
    wi, wo = (
        directions(50, torch.Generator().manual_seed(3), 0.05),
        directions(50, torch.Generator().manual_seed(4), 0.05),
    )
    color = torch.tensor([0.9, 0.4, 0.1], dtype=torch.float64)
    mixed = MetallicRoughness(color, 0.3, 0.5, ior=1.8, **words).double()
    low = ((1.8 - 1) / (1.8 + 1)) ** 2
    alpha = 0.25 + 0.75 * words.get("anisotropy", 0.0) ** 2
    facets = RoughConductor(GGX(alpha, 0.25), Schlick(low + (color - low) * 0.3), SingleBounce()).double()
    torch.testing.assert_close(mixed.orders(wi, wo)[:, 0], facets(wi, wo), rtol=1e-6, atol=1e-9)
    metal = MetallicRoughness(color, 1.0, 0.5, **words).double()
    assert not bool(metal.orders(wi, wo)[:, -1].any())


def gltf(color: Tensor, metallic: float, roughness: float, v: Tensor, to: Tensor) -> Tensor:
    """f · cos of glTF 2.0, Appendix B.3, written from its formulas; ior 1.5."""
    h = torch.nn.functional.normalize(v + to, dim=-1)
    nv, nl, nh, vh = (x.unsqueeze(-1) for x in (v[:, 2], to[:, 2], h[:, 2], (v * h).sum(-1)))
    a2 = roughness**4
    D = a2 / (math.pi * (nh**2 * (a2 - 1) + 1) ** 2)
    V = 0.5 / (nl * (a2 + (1 - a2) * nv**2).sqrt() + nv * (a2 + (1 - a2) * nl**2).sqrt())
    f0 = 0.04 + (color - 0.04) * metallic
    F = f0 + (1 - f0) * (1 - vh) ** 5
    dielectric = 1 - (0.04 + 0.96 * (1 - vh) ** 5)
    return (F * D * V + (1 - metallic) * dielectric * color / math.pi) * nl


def test_one_bounce_is_gltf(generator):
    wi, wo = directions(200, generator, 0.02), directions(200, generator, 0.02)
    color = torch.tensor([0.9, 0.4, 0.1], dtype=torch.float64)
    for metallic, roughness in itertools.product((0.0, 0.5, 1.0), (0.2, 0.6, 1.0)):
        surface = MetallicRoughness(color, metallic, roughness, bounces="one").double()
        torch.testing.assert_close(surface(wi, wo), gltf(color, metallic, roughness, wi, wo), rtol=1e-6, atol=1e-9)


def test_the_base_is_all_that_changes_with_diffuse(generator):
    """And rough facets without a roughness are Lambert's."""
    wi, wo = directions(50, generator, 0.2), directions(50, generator, 0.2)
    plain, rough = (MetallicRoughness([0.5], 0.0, 0.9, diffuse=d).double().orders(wi, wo) for d in ("lambert", "rough"))
    torch.testing.assert_close(plain[:, :-1], rough[:, :-1])
    assert float((plain[:, -1] / rough[:, -1] - 1).abs().max()) > 0.1
    plain, rough = (MetallicRoughness([0.5], 0.0, 0.05, diffuse=d).double()(wi, wo) for d in ("lambert", "rough"))
    torch.testing.assert_close(plain, rough, rtol=0.03, atol=1e-3)


@pytest.mark.parametrize("kind", [pytest.param(k, marks=[] if k == "lambert" else [pytest.mark.slow]) for k in KINDS])
def test_laws(kind):
    report = law_suite(MetallicRoughness([0.9, 0.5, 0.1], 0.4, 0.6, **KINDS[kind]), samples=5000)
    assert not report.failed, report


@pytest.mark.slow
@each("kind", KINDS)
def test_compiled_is_eager(kind, generator):
    """Values, samples and gradients of every map, lights before the pixels."""
    base = torch.rand(6, 5, 3, generator=generator, requires_grad=True)
    maps = [torch.rand(6, 5, 1, generator=generator, requires_grad=True) for _ in range(3)]
    words = {**KINDS[kind]} | ({"anisotropy": maps[2]} if "anisotropy" in KINDS[kind] else {})
    surface = MetallicRoughness(base, maps[0], maps[1], **words)
    wi, wo = (
        directions(30, generator, 0.05, torch.float32).reshape(6, 5, 3),
        directions(4, generator, 0.05, torch.float32),
    )
    found = []
    for each_ in (surface, torchms.compile(surface, verbose=False)):
        value = each_(wi, wo[:, None, None])
        leaves = [base, *maps[: 3 if "anisotropy" in words else 2]]
        found.append([value, *torch.autograd.grad(value.square().sum(), leaves), each_.pdf(wi, wo[:, None, None])])
    for a, b in zip(*found, strict=True):
        torch.testing.assert_close(a, b, rtol=2e-4, atol=1e-5)


def test_gradients_are_finite_at_the_ends():
    """Of maps that are 0 and 1: black, white, no metal, all metal, smooth, rough."""
    ends = torch.tensor(list(itertools.product((0.0, 1.0), repeat=4)))
    base, metallic, roughness, bent = (ends[:, k].clone().requires_grad_() for k in range(4))
    for words in ({}, {"diffuse": "rough"}, {"bounces": "one"}, {"anisotropy": bent}):
        leaves = [base, metallic, roughness, *([bent] if "anisotropy" in words else [])]
        surface = MetallicRoughness(base[:, None], metallic, roughness, **words)
        for theta in (0.0, 0.8, math.pi / 2):
            wi, wo = direction(theta, 0.7, torch.float32), direction(0.5, 2.0, torch.float32)
            drawn = surface.sample(wi, torchms.Stream(1))
            value = surface(wi, wo).sum() + surface.pdf(wi, wo).sum() + drawn.wo.sum() + drawn.pdf.sum()
            assert all(bool(g.isfinite().all()) for g in torch.autograd.grad(value, leaves))


@pytest.mark.slow
@pytest.mark.usefixtures("messages")  # run-time checks of types read sizes, which are open in a file
def test_exported(tmp_path, generator):
    """One file: maps in, radiance out, and the numbers of eager code."""
    path = torchms.onnx.export(
        MetallicRoughness([0.5] * 3, 0.5, 0.5), tmp_path / "m.onnx", parameters=("base_color", "metallic", "roughness")
    )
    wi, wo = (directions(500, generator, 0.05, torch.float32) for _ in range(2))
    base = torch.rand(500, 3, generator=generator)
    metallic, roughness = (torch.rand(500, generator=generator) for _ in range(2))
    fed = {"wi": wi, "wo": wo, "base_color": base, "metallic": metallic, "roughness": roughness}
    session = onnxruntime.InferenceSession(str(path))
    assert {x.name for x in session.get_inputs()} == set(fed)
    (value,) = session.run(None, {name: x.numpy() for name, x in fed.items()})
    torch.testing.assert_close(
        torch.from_numpy(value), MetallicRoughness(base, metallic, roughness)(wi, wo), rtol=1e-4, atol=1e-6
    )


# Maps.


def test_maps_with_an_axis_of_one(generator):
    """(H, W, 1) is (H, W), beside a colour (H, W, 3) and beside one colour."""
    wi = directions(20, generator, 0.1, torch.float32).reshape(4, 5, 3)
    wo = directions(3, generator, 0.1, torch.float32)[:, None, None]
    metallic, roughness = (torch.rand(4, 5, generator=generator) for _ in range(2))
    base = torch.rand(4, 5, 3, generator=generator)
    for color, lights in ((base, wo), (torch.tensor([0.2, 0.5, 0.8]), wo[0])):
        expected = MetallicRoughness(color, metallic, roughness)(wi, lights)
        given = MetallicRoughness(color, metallic[..., None], roughness[..., None])
        assert torch.equal(given(wi, lights), expected)


@pytest.mark.usefixtures("messages")
@pytest.mark.parametrize(
    "base,metallic,message",
    [
        ((4, 5), (4, 5), r"base_color of shape \(4, 5\) beside metallic of shape \(4, 5\).*base_color\[..., None\]"),
        ((4, 5, 3), (4, 5, 3), r"the last axis of base_color is that of the channels, and metallic has none"),
        ((4, 5, 3), (5, 4), r"the batches \(4, 5\) and \(5, 4\) are not those of one map"),
        ((4, 1, 3), (5,), r"the batches \(4, 1\) and \(5,\) are not those of one map"),
        ((5, 3), (4, 1), r"the batches \(5,\) and \(4, 1\) are not those of one map"),
    ],
)
def test_maps_that_do_not_belong_together(base, metallic, message):
    with pytest.raises(ValueError, match=message):
        MetallicRoughness(torch.rand(base), torch.rand(metallic), 0.5)


@pytest.mark.usefixtures("messages")
def test_what_is_refused():
    for words, message in (
        ({"diffuse": "burley"}, r"diffuse=...\) must be one of lambert, rough; got 'burley'"),
        ({"bounces": 2}, r"bounces=...\) must be one of all, one; got 2"),
        ({"ior": 0.9}, r"ior=...\) must lie in \[1, 3\]; got 0.9"),
        ({"anisotropy": -0.5}, r"anisotropy=...\) must lie in \[0, 1\]; got -0.5"),
    ):
        with pytest.raises(ValueError, match=message):
            MetallicRoughness([0.5], 0.5, 0.5, **words)
    for numbers, message in (
        (([1.5], 0.5, 0.5), r"base_color=...\) must lie in \[0, 1\]; got 1.5"),
        (([0.5], 1.5, 0.5), r"metallic=...\) must lie in \[0, 1\]; got 1.5"),
        (([0.5], 0.5, math.nan), r"roughness=...\) must lie in \[0, 1\]; got nan"),
    ):
        with pytest.raises(ValueError, match=message):
            MetallicRoughness(*numbers)


def test_it_is_trained_in_its_range():
    surface = MetallicRoughness([0.5, 0.5, 0.5], 0.5, 0.5)
    torchms.constrain(surface, "base_color", "roughness", "metallic")
    wi, wo = direction(0.5, 0.7, torch.float32), direction(0.9, 2.0, torch.float32)
    adam = torch.optim.Adam(surface.parameters(), lr=0.5)
    for _ in range(20):
        adam.zero_grad()
        (-surface(wi, wo).sum()).backward()
        adam.step()
    for record, value in parameters(surface).values():
        assert record.low <= float(value.detach().min()) and float(value.detach().max()) <= record.high
    assert float(surface.base_color.detach().min()) > 0.9


# The table.


def test_the_table_is_that_of_the_lobes():
    """Whoever trains them anew writes it anew: python -m tools.generate_layered."""
    assert LayeredTable.packaged().lobes == fingerprint()


def test_a_table_of_its_own_dtype():
    """Surfaces share what was read from the file, not the module: one in float64 leaves the others alone."""
    a, b = MetallicRoughness([0.5], 0.5, 0.5).double(), MetallicRoughness([0.5], 0.5, 0.5)
    assert isinstance(a.scattering, Whitened) and isinstance(b.scattering, Whitened)
    assert a.scattering.table.c_level.dtype == torch.float64 and b.scattering.table.c_level.dtype == torch.float32


@pytest.mark.usefixtures("messages")
def test_a_damaged_table(tmp_path):
    whole = {name: np.zeros(shape, np.float32) for name, shape in SHAPES.items()}
    path = tmp_path / "table.npz"
    for content, message in (
        (whole, "is no file of layers: it does not say its format"),
        (whole | {"format": np.array(1), "level": np.zeros(3, np.float32)}, r"'level' must be finite numbers"),
        ({**whole, "format": np.array(1), "level": np.full(SHAPES["level"], np.nan, np.float32)}, "must be finite"),
    ):
        np.savez(path, **content)
        with pytest.raises(ValueError, match=message):
            LayeredTable.load(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match=r"truncated or no \.npz file"):
        LayeredTable.load(path)


def test_whitened_as_a_scattering():
    """Its place in a conductor is that of `Distilled`: white, for α that has no lobes too."""
    wi = torch.stack([direction(t) for t in (0.0, 0.7, 1.2)])
    for alpha in (0.01, 0.1, 0.5, 1.0):
        metal = RoughConductor(GGX(alpha), Schlick([1.0]), Whitened()).double()
        drawn = metal.sample(
            wi, metal.uniforms((), POINTS, sequence="sobol", generator=torch.Generator().manual_seed(1))
        )
        energy = (metal(wi, drawn) / drawn.pdf[..., None]).mean(1)
        assert float((energy - 1).abs().max()) < 3e-3
