"""The plugins in Mitsuba against torch: values, densities, samples, parameters, gradients.

Scalar variants need Mitsuba alone; those of Dr.Jit need an LLVM of version 17 or later as well (Debian: libllvm19).
"""

import gc
from collections.abc import Callable
from importlib import import_module
from typing import Any

import pytest
import torch
from torch import Tensor

from torchms import (
    BSDF,
    GGX,
    Beckmann,
    Distilled,
    HeightWalk,
    Invariance,
    MetallicRoughness,
    RoughConductor,
    RoughDielectric,
    RoughDiffuse,
    Unidirectional,
)
from torchms.fresnel import Conductor, Dielectric
from torchms.machine.program import Program

pytest.importorskip("mitsuba", reason="needs Mitsuba 3 (pip install mitsuba)")

from torchms.mitsuba import find_llvm, noise, register
from torchms.mitsuba.branches import LEAST, Branch, Planner

needs_llvm = pytest.mark.skipif(find_llvm() is None, reason="needs an LLVM of version 17 or later (Debian: libllvm19)")
TOLERANCE = 1e-5
COLOR = [0.9, 0.5, 0.2]
ETA, K = [0.2, 0.9, 1.4], [3.0, 2.4, 1.9]


def rgb(values: list[float], kind: str = "rgb") -> dict[str, Any]:
    return {"type": kind, "value": values}


METAL = {"type": "torchms_conductor", "eta": rgb(ETA), "k": rgb(K)}
GLASS = {"type": "torchms_dielectric", "int_ior": 1.5, "ext_ior": 1.0}
CHALK = {"type": "torchms_diffuse", "reflectance": rgb(COLOR)}
ROUND, BENT = {"distribution": "ggx", "alpha": 0.4}, {"distribution": "beckmann", "alpha_u": 0.5, "alpha_v": 0.2}
EXACT: dict[str, Any] = {"scattering": "exact", "max_order": 2, "seed": 7}

GLTF = {"type": "torchms_metallic_roughness", "base_color": rgb(COLOR), "metallic": 0.3, "roughness": 0.6}

CASES: dict[str, tuple[dict[str, Any], Callable[[], BSDF]]] = {
    "metal": (METAL | ROUND, lambda: RoughConductor(GGX(0.4), Conductor(ETA, K), Distilled())),
    "metal-bent": (METAL | BENT, lambda: RoughConductor(Beckmann(0.5, 0.2), Conductor(ETA, K), Distilled())),
    "glass": (GLASS | ROUND, lambda: RoughDielectric(GGX(0.4), Dielectric(1.5), Distilled())),
    "glass-bent": (GLASS | BENT, lambda: RoughDielectric(Beckmann(0.5, 0.2), Dielectric(1.5), Distilled())),
    "chalk": (CHALK | BENT, lambda: RoughDiffuse(Beckmann(0.5, 0.2), COLOR, Distilled())),
    "gltf": (GLTF, lambda: MetallicRoughness(COLOR, 0.3, 0.6)),
    "gltf-bent": (
        GLTF | {"anisotropy": 0.5, "diffuse": "rough"},
        lambda: MetallicRoughness(COLOR, 0.3, 0.6, anisotropy=0.5, diffuse="rough"),
    ),
    "gltf-one": (GLTF | {"bounces": "one"}, lambda: MetallicRoughness(COLOR, 0.3, 0.6, bounces="one")),
    "metal-exact": (
        METAL | ROUND | EXACT,
        lambda: RoughConductor(GGX(0.4), Conductor(ETA, K), Unidirectional(Invariance(), 2)),
    ),
    "glass-exact": (GLASS | ROUND | EXACT, lambda: RoughDielectric(GGX(0.4), Dielectric(1.5), HeightWalk(2))),
    "chalk-exact": (CHALK | ROUND | EXACT, lambda: RoughDiffuse(GGX(0.4), COLOR, Unidirectional(Invariance(), 2))),
}


def directions(n: int, both: bool, generator: torch.Generator) -> Tensor:
    w = torch.nn.functional.normalize(torch.randn(n, 3, generator=generator), dim=-1)
    return w if both else torch.stack([w[:, 0], w[:, 1], w[:, 2].abs()], -1)


def numbers(x: Any) -> Tensor:
    """(n, C) of a spectrum, (n) of a number."""
    found = torch.as_tensor(import_module("numpy").array(x)).float()
    return found.mT.contiguous() if found.ndim > 1 else found


def interaction(mi: Any, wi: Tensor) -> Any:
    """One in each row, at different places."""
    si = import_module("drjit").zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(wi.mT.numpy())
    si.p = mi.Point3f(3 * wi.mT.numpy() + 1)
    return si


def found(mi: Any, plugin: dict[str, Any], wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
    """f · |cos θ_o|, density, and the random numbers that were taken, one call a row in a scalar variant."""
    bsdf, context = mi.load_dict(plugin), mi.BSDFContext()
    n = bsdf.surface.kernels["radiance"].n_numbers
    if mi.variant().startswith("llvm"):
        si, d = interaction(mi, wi), mi.Vector3f(wo.mT.numpy())
        u = noise.numbers(si, d, n, plugin.get("seed", 0))
        value, pdf = bsdf.eval_pdf(context, si, d)
        return numbers(value), numbers(pdf), torch.stack([numbers(x) for x in u], -1)[:, None] if n else None
    rows: list[tuple[list[float], float, list[float]]] = []
    for a, b in zip(wi.tolist(), wo.tolist(), strict=True):
        si = mi.SurfaceInteraction3f()
        si.wi, si.p = mi.Vector3f(*a), mi.Point3f(*(3 * x + 1 for x in a))
        value, pdf = bsdf.eval_pdf(context, si, mi.Vector3f(*b))
        rows.append(([float(x) for x in value], pdf, noise.numbers(si, mi.Vector3f(*b), n, plugin.get("seed", 0))))
    value, pdf, u = (torch.tensor(column) for column in zip(*rows, strict=True))
    return value, pdf, u[:, None] if n else None


def check_equal(mi: Any, case: str, n: int, generator: torch.Generator) -> None:
    """In single precision against double: near total reflection that is what the last digits of either are worth."""
    plugin, make = CASES[case]
    wi, wo = (directions(n, "glass" in case, generator) for _ in range(2))
    value, pdf, u = found(mi, plugin, wi, wo)
    surface = make().double()
    expected = surface(wi.double(), wo.double(), None if u is None else u.double())
    for ours, theirs in ((value, expected.expand_as(value)), (pdf, surface.pdf(wi.double(), wo.double()))):
        error = (ours - theirs).abs() / (theirs.abs() + 0.1)
        assert float(error.max()) < 2 * TOLERANCE, (case, float(error.max()))
        assert float(error.quantile(0.99)) < TOLERANCE / 2, (case, float(error.quantile(0.99)))
    assert float(value.max()) > 0.01


QUICK = [pytest.param(name, marks=[] if name in ("metal", "glass-exact") else pytest.mark.slow) for name in CASES]


@pytest.mark.parametrize("case", QUICK)
def test_scalar_equals_eager(variant, case, generator):
    check_equal(variant("scalar_rgb"), case, 8, generator)


@needs_llvm
@pytest.mark.parametrize("case", QUICK)
def test_jit_equals_eager(variant, case, generator):
    check_equal(variant("llvm_ad_rgb"), case, 5000, generator)


@needs_llvm
@pytest.mark.parametrize("name", ["llvm_ad_mono", "llvm_ad_spectral", "llvm_ad_spectral_polarized"])
def test_other_colours(variant, name, generator):
    """A gray metal is the same in every kind of colour."""
    mi = variant(name)
    wi, wo = directions(50, False, generator), directions(50, False, generator)
    bsdf = mi.load_dict({"type": "torchms_conductor", "eta": 0.8, "k": 2.5} | ROUND)
    value = bsdf.eval(mi.BSDFContext(), interaction(mi, wi), mi.Vector3f(wo.mT.numpy()))
    value = numbers(value[0, 0] if mi.is_polarized else value)
    expected = RoughConductor(GGX(0.4), Conductor(0.8, 2.5), Distilled())(wi, wo)
    torch.testing.assert_close(value, expected.expand_as(value), rtol=1e-5, atol=1e-6)


def check_samples(mi: Any, plugin: dict[str, Any], wi: Tensor, u: Tensor) -> None:
    """weight · density is the value at the direction drawn, and both know the density."""
    dr = import_module("drjit")
    bsdf, jit = mi.load_dict(plugin), mi.variant().startswith("llvm")
    for mode in (mi.TransportMode.Radiance, mi.TransportMode.Importance):
        context = mi.BSDFContext(mode)
        for a, v in [(wi, u)] if jit else zip(wi[:, None], u[:, None], strict=True):
            si = interaction(mi, a) if jit else mi.SurfaceInteraction3f()
            si.wi = mi.Vector3f(a.mT.numpy() if jit else a[0].tolist())
            x, y, z = (mi.Float(c.numpy()) for c in v.mT) if jit else v[0].tolist()
            sample, weight = bsdf.sample(context, si, x, mi.Point2f(y, z))
            value, pdf = bsdf.eval_pdf(context, si, sample.wo)
            size = 1 + (dr.max(value, axis=None) if jit else max(value))
            assert dr.all(dr.max(dr.abs(weight * sample.pdf - value)) <= TOLERANCE * size, axis=None)
            assert dr.all(abs(pdf - sample.pdf) <= TOLERANCE * (1 + pdf), axis=None)
            assert dr.all((sample.pdf > 0) & (dr.max(value) >= 0), axis=None)
            crossed = sample.wo.z * si.wi.z < 0
            transmission = +mi.BSDFFlags.GlossyTransmission
            assert dr.all((sample.sampled_type == transmission) == crossed, axis=None)


@pytest.mark.parametrize("case", QUICK)
def test_scalar_samples(variant, case, generator):
    wi = directions(6, "glass" in case, generator)
    check_samples(variant("scalar_rgb"), CASES[case][0], wi, torch.rand(6, 3, generator=generator))


@needs_llvm
@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_jit_samples(variant, case, generator):
    wi = directions(5000, "glass" in case, generator)
    check_samples(variant("llvm_ad_rgb"), CASES[case][0], wi, torch.rand(5000, 3, generator=generator))


def test_components(variant):
    """What a context does not ask for is dark; the two components sum to the whole."""
    mi = variant("scalar_rgb")
    bsdf = mi.load_dict(CASES["glass"][0])
    assert bsdf.component_count() == 2 and bsdf.flags() & +mi.BSDFFlags.BackSide
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0.6, 0, 0.8)
    for wo, own in ((mi.Vector3f(0, 0.6, 0.8), 0), (mi.Vector3f(0, 0.6, -0.8), 1)):
        parts = []
        for component in (0, 1):
            context = mi.BSDFContext()
            context.component = component
            parts.append(bsdf.eval_pdf(context, si, wo))
        whole = bsdf.eval_pdf(mi.BSDFContext(), si, wo)
        assert list(parts[own][0]) == list(whole[0]) and parts[own][1] == whole[1] > 0
        assert max(parts[1 - own][0]) == 0 == parts[1 - own][1]


REFUSED = {
    "a word": ({"scattering": "fast"}, "must be one of distilled, exact; got 'fast'"),
    "another": ({"distribution": "gtr"}, "must be one of beckmann, ggx"),
    "both": ({"alpha": 0.3, "alpha_u": 0.2}, "give either alpha, or alpha_u and alpha_v"),
    "smooth": ({"alpha": 0.01}, r"alpha.value must lie in \[0.03, 1\]; got 0.01.*exact"),
    "too smooth": ({"alpha": 1e-4, "scattering": "exact"}, r"must lie in \[0.001, 2\]"),
    "no paths": ({"paths": 0}, r"paths must be a whole number in \[1, 16\]; got 0"),
    "twice": ({"eta": 1.3, "material": "Au", "k": 1.0}, "give either material, or eta and k"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(variant, case):
    mi = variant("scalar_rgb")
    given, message = REFUSED[case]
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({"type": "torchms_conductor"} | given)


def test_parameters_are_mitsubas(variant):
    """Names, defaults and materials are those of Mitsuba's own plugins; XML serves as well."""
    mi = variant("scalar_rgb")
    ours, theirs = (mi.traverse(mi.load_dict({"type": t})) for t in ("torchms_conductor", "roughconductor"))
    shown = {key: ours[key] for key in ours.keys() if "specular" not in key}  # noqa: SIM118
    assert shown == {key: theirs[key] for key in shown}
    glass = mi.load_string(
        '<bsdf version="3.0.0" type="torchms_dielectric"><string name="int_ior" value="diamond"/>'
        '<float name="alpha_u" value="0.2"/><float name="alpha_v" value="0.3"/></bsdf>'
    )
    shown = mi.traverse(glass)
    assert shown["eta.value"] == pytest.approx(2.419 / 1.000277) and shown["alpha_v.value"] == pytest.approx(0.3)
    shown["eta.value"] = 1.7
    shown.update()
    assert mi.traverse(glass)["eta.value"] == pytest.approx(1.7)
    shown["eta.value"] = 4.0
    with pytest.raises(ValueError, match=r"eta.value must lie in \[0.333333, 3\]; got 4"):
        shown.update()


@needs_llvm
def test_updates_and_maps(variant):
    """An update is seen by the next call, one out of range is refused; a bitmap is read where the surface is met."""
    mi, np = variant("llvm_ad_rgb"), import_module("numpy")
    ramp = np.linspace(0.2, 0.8, 64, dtype=np.float32).reshape(1, 64, 1).repeat(2, 0)
    texture = {"type": "bitmap", "data": mi.TensorXf(ramp), "raw": True, "filter_type": "nearest"}
    mapped, plain = (mi.load_dict(METAL | {"distribution": "ggx", "alpha": a}) for a in (texture, 0.3))
    wi = torch.tensor([[0.3, 0.1, 0.9]]).expand(3, 3) / torch.tensor([[0.3, 0.1, 0.9]]).norm()
    si, wo, context = interaction(mi, wi), mi.Vector3f([0.1] * 3, [0.2] * 3, [0.97] * 3), mi.BSDFContext()
    si.uv = mi.Point2f([0.01, 0.5, 0.99], 0.5)
    values = numbers(mapped.eval(context, si, wo))
    shown = mi.traverse(plain)
    for row, column in enumerate((0, 32, 63)):
        shown["alpha.value"] = float(ramp[0, column, 0])
        shown.update()
        torch.testing.assert_close(numbers(plain.eval(context, si, wo))[row], values[row], rtol=1e-4, atol=1e-5)
    shown["alpha.value"] = 1.5
    with pytest.raises(ValueError, match=r"alpha.value must lie in \[0.03, 1\]; got 1.5"):
        shown.update()


HALF = {"specular_reflectance": 0.5}
MAPPED: dict[str, dict[str, Any]] = {
    "metal": METAL | BENT | HALF,
    "glass": {"type": "torchms_dielectric", "eta": 1.4} | BENT | HALF | {"specular_transmittance": 0.25},
    "chalk": CHALK | ROUND,
    "gltf": GLTF | {"anisotropy": 0.5, "eta": 1.4},
}


@needs_llvm
@pytest.mark.slow
@pytest.mark.parametrize("case", MAPPED)
def test_every_parameter_may_be_a_map(variant, case, generator):
    """Numbers and colours, and bitmaps of them beside something else, give the same."""
    mi, np = variant("llvm_ad_rgb"), import_module("numpy")

    def texture(value: Any) -> dict[str, Any]:
        row = np.array(value["value"] if isinstance(value, dict) else [value], np.float32)
        pixels = np.stack([0.9 * row, row])[None].repeat(2, 0)
        return {"type": "bitmap", "data": mi.TensorXf(pixels), "raw": True, "filter_type": "nearest"}

    plain = MAPPED[case]
    mapped = {key: x if key in ("type", "distribution") else texture(x) for key, x in plain.items()}
    wi, wo = (directions(200, case == "glass", generator) for _ in range(2))
    si, d, context = interaction(mi, wi), mi.Vector3f(wo.mT.numpy()), mi.BSDFContext()
    si.uv = mi.Point2f(0.75, 0.5)
    ours, theirs = (mi.load_dict(x).eval_pdf(context, si, d) for x in (mapped, plain))
    for a, b in zip(ours, theirs, strict=True):
        torch.testing.assert_close(numbers(a), numbers(b), rtol=1e-5, atol=1e-6)
    assert float(numbers(ours[0]).max()) > 0.01


@needs_llvm
@pytest.mark.parametrize("plugin", [GLASS, {"type": "torchms_conductor", "material": "Au"}], ids=["glass", "gold"])
def test_nothing_lives_beside_a_plugin(variant, plugin):
    """Mitsuba compiles every BSDF that lives: what is asked for defaults and metals is gone at once, without a collector."""
    mi, dr = variant("llvm_ad_rgb"), import_module("drjit")

    def place(bsdf: Any) -> int:
        return int(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdf))[0])

    gc.collect()
    gc.disable()
    try:
        bsdf = mi.load_dict(plugin)
        assert place(mi.load_dict({"type": "diffuse"})) == place(bsdf) + 1
    finally:
        gc.enable()


def test_a_choice_between_long_sides_is_a_branch():
    """Each side is computed once, on its own; what both need, and what follows, is not in it."""
    program = Program()
    x, y = program.add("column", "f", 0), program.add("column", "f", 1)
    mask = program.add("lt", "b", x, y)
    sides = []
    for name in ("sin", "cos"):
        value = program.add("mul", "f", x, y)
        for _ in range(LEAST):
            value = program.add(name, "f", value)
        sides.append(value)
    chosen = program.add("where", "f", mask, *sides)
    program.results = [program.add("add", "f", chosen, x)]
    plan = Planner(program, lambda v: program.taken(program.operations[v])).plan(branches=True)
    (branch,) = (step for step in plan.steps if isinstance(step, Branch))
    assert branch.mask == mask and list(branch.results) == [chosen]
    for side, name in ((branch.yes, "sin"), (branch.no, "cos")):
        assert [program.operations[v].name for v in side.steps if not isinstance(v, Branch)] == [name] * LEAST
        assert len(side.steps) == LEAST
    assert [program.operations[v].name for v in plan.steps if not isinstance(v, Branch)][-1] == "add"
    assert Planner(program, lambda v: program.taken(program.operations[v])).plan(branches=False).steps == [
        *range(7 + 2 * LEAST - 1)
    ]


def test_no_mitsuba(monkeypatch):
    import torchms.mitsuba.plugin as plugin

    def missing(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(plugin, "import_module", missing)
    with pytest.raises(ImportError, match=r'pip install "torchms\[mitsuba\]"'):
        register()
