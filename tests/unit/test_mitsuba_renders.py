"""Pictures in Mitsuba: energy, Mitsuba's own test of samples, and gradients of its integrators."""

import math
from importlib import import_module
from typing import Any

import pytest
import torch

pytest.importorskip("mitsuba", reason="needs Mitsuba 3 (pip install mitsuba)")

from test_mitsuba_plugins import CHALK, EXACT, GLASS, GLTF, METAL, needs_llvm

WHITE = {
    "metal": {"type": "torchms_conductor", "material": "none"},
    "glass": {"type": "torchms_dielectric", "int_ior": 1.5, "ext_ior": 1.0},
    "chalk": {"type": "torchms_diffuse", "reflectance": 1.0},
    "gltf": {"type": "torchms_metallic_roughness", "base_color": 1.0, "metallic": 0.4},
}


def sphere(mi: Any, bsdf: dict[str, Any], emitter: dict[str, Any], integrator: dict[str, Any], size: int) -> Any:
    """A ball that fills the picture's inner half."""
    view = mi.ScalarTransform4f().look_at([0, 0, 6], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": integrator,
            "sensor": {"type": "perspective", "fov": 18, "to_world": view, "film": film},
            "light": emitter,
            "ball": {"type": "sphere", "bsdf": bsdf},
        }
    )


def inside(picture: Any, radius: float) -> torch.Tensor:
    """The pixels within `radius` of the picture's half width."""
    pixels = torch.as_tensor(import_module("numpy").array(picture))
    x = (torch.arange(len(pixels)) + 0.5) / len(pixels) * 2 - 1
    return pixels[(x[:, None] ** 2 + x[None] ** 2) < radius**2]


FURNACES = [
    *(("metal", a, i) for a in (0.1, 0.3, 0.6) for i in ("path", "direct")),
    *(("gltf", a, i) for a in (0.1, 0.3, 0.6, 1.0) for i in ("path", "direct")),
    *(("chalk", a, i) for a in (0.3, 0.6) for i in ("path", "direct")),
]


@needs_llvm
@pytest.mark.parametrize(
    ("material", "alpha", "integrator"),
    [pytest.param(*case, marks=[] if case == ("metal", 0.3, "path") else pytest.mark.slow) for case in FURNACES],
)
def test_white_furnace(variant, material, alpha, integrator):
    """A white ball in a white room is not seen."""
    mi = variant("llvm_ad_rgb")
    rough = {"roughness": math.sqrt(alpha)} if material == "gltf" else {"distribution": "ggx", "alpha": alpha}
    bsdf = WHITE[material] | rough
    scene = sphere(mi, bsdf, {"type": "constant", "radiance": 1.0}, {"type": integrator}, 64)
    found = inside(mi.render(scene, spp=64, seed=1), 0.99)
    assert abs(float(found.mean()) - 1) < 2e-3


@needs_llvm
@pytest.mark.slow
@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_glass_ball_keeps_all_light(variant, alpha):
    """What a ball of glass reflects and transmits is what a white room sends it."""
    mi = variant("llvm_ad_rgb")
    scene = sphere(
        mi,
        WHITE["glass"] | {"distribution": "ggx", "alpha": alpha},
        {"type": "constant", "radiance": 1.0},
        {"type": "path", "max_depth": 64, "rr_depth": 1000},
        64,
    )
    assert abs(float(inside(mi.render(scene, spp=64, seed=1), 0.99).mean()) - 1) < 0.01


CHI2 = [
    (material, alpha, theta)
    for material in WHITE
    for alpha in (0.1, 0.4, 1.0, (0.5, 0.15))
    for theta in (0.2, 0.9, 1.4, *((2.1, 2.9) if material == "glass" else ()))
] + [("glass", (0.5, 0.1), 1.4)]


@needs_llvm
@pytest.mark.parametrize(
    ("material", "alpha", "theta"),
    [pytest.param(*case, marks=[] if case == ("metal", 0.4, 0.9) else pytest.mark.slow) for case in CHI2],
)
def test_mitsubas_chi2(variant, material, alpha, theta):
    """Samples follow the density, which sums to one, by Mitsuba's own test."""
    mi = variant("llvm_ad_rgb")
    chi2 = import_module("mitsuba.chi2")
    split = isinstance(alpha, tuple)
    rough: dict[str, Any] = dict(zip(("alpha_u", "alpha_v"), alpha, strict=True)) if split else {"alpha": alpha}
    wi = mi.ScalarVector3f(0.8 * math.sin(theta), 0.6 * math.sin(theta), math.cos(theta))
    if material == "gltf":
        rough = {"roughness": math.sqrt(alpha)} if not split else {"roughness": 0.5, "anisotropy": 0.5}
    else:
        rough["distribution"] = "ggx"
    plugin = WHITE[material] | rough
    sample, density = chi2.BSDFAdapter(plugin["type"], plugin, wi=wi)
    # Steep lobes need fine cells: the density is integrated by the trapezoid rule.
    fine = alpha == 0.1 or split or theta == 1.4
    test = chi2.ChiSquareTest(
        chi2.SphericalDomain(), sample, density, 3, 400_000, res=201 if fine else 51, ires=16 if fine else 32
    )
    assert test.run(0.001, test_count=len(CHI2), quiet=True), test.messages
    assert abs(float(test.pdf_sum[0]) - 1) < 2e-3


GRADIENTS = {
    "metal-alpha": (METAL | {"alpha": 0.4}, "alpha.value"),
    "metal-eta": (METAL | {"alpha": 0.4}, "eta.value"),
    "chalk-alpha": (CHALK | {"alpha": 0.4}, "alpha.value"),
    "chalk-colour": (CHALK | {"alpha": 0.4}, "reflectance.value"),
    "glass-alpha": (GLASS | {"alpha": 0.4}, "alpha.value"),
    "glass-eta": (GLASS | {"alpha": 0.4}, "eta"),
    "gltf-colour": (GLTF, "base_color.value"),
    "gltf-roughness": (GLTF, "roughness.value"),
    "metal-exact": (METAL | {"alpha": 0.4, "scattering": "exact", "max_order": 3}, "alpha.value"),
}


def lamp(mi: Any) -> dict[str, Any]:
    """A room that is brighter on one side, without edges."""
    np = import_module("numpy")
    y, x = np.mgrid[0:16, 0:32]
    left = 1 + 0.9 * np.sin(x / 32 * 2 * np.pi)
    pixels = np.stack([left, 0.7 + 0.5 * np.cos(y / 16 * np.pi), left], -1).astype(np.float32)
    return {"type": "envmap", "bitmap": mi.Bitmap(pixels)}


class Derivative:
    """Of a weighted mean of a small picture with respect to one number: replayed backwards, forwards, as a difference."""

    def __init__(self, mi: Any, case: str, step: float) -> None:
        self.mi, self.dr, self.step = mi, import_module("drjit"), step
        np = import_module("numpy")
        bsdf, self.key = GRADIENTS[case]
        self.bsdf = bsdf if "gltf" in case else bsdf | {"distribution": "ggx"}
        weights = np.random.default_rng(0).uniform(0, 1, (12, 12, 3))
        if "glass" in case:
            # Smoother glass is brighter in the middle and darker at the rim: a mean over both would be all noise.
            x = (np.arange(12) + 0.5) / 6 - 1
            weights = np.clip(1 - x[:, None, None] ** 2 - x[None, :, None] ** 2, 0, 1).repeat(3, -1)
        self.weights = mi.TensorXf(weights.astype(np.float32))

    def loss(self, picture: Any) -> Any:
        return self.dr.mean(picture * self.weights, axis=None)

    def moved(self, integrator: str, change: Any) -> tuple[Any, Any]:
        scene = sphere(self.mi, self.bsdf, lamp(self.mi), {"type": integrator, "max_depth": 4, "rr_depth": 100}, 12)
        shown, name = self.mi.traverse(scene), f"ball.bsdf.{self.key}"
        shown[name] = type(shown[name])(shown[name]) + change
        shown.update()
        return scene, shown

    def backward(self, spp: int, seed: int) -> float:
        change = self.mi.Float(0)
        self.dr.enable_grad(change)
        scene, shown = self.moved("prb", change)
        self.dr.backward(self.loss(self.mi.render(scene, shown, spp=spp, seed=seed)))
        return float(self.dr.grad(change)[0])

    def forward(self, spp: int, seed: int) -> float:
        change = self.mi.Float(0)
        self.dr.enable_grad(change)
        scene, shown = self.moved("path", change)
        picture = self.mi.render(scene, shown, spp=spp, seed=seed)
        self.dr.forward(change)
        return float(self.loss(self.dr.grad(picture)).array[0])

    def difference(self, spp: int, seed: int) -> float:
        found = 0.0
        for sign in (1, -1):
            scene, _ = self.moved("path", sign * self.step)
            found += sign * float(self.loss(self.mi.render(scene, spp=spp, seed=seed)).array[0])
        return found / (2 * self.step)


@needs_llvm
@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in GRADIENTS if "glass" not in case and "exact" not in case])
def test_gradients(variant, case):
    """Replayed backwards (`prb`), forwards through `path`, and as a difference: of a weighted mean of a picture."""
    derivative, spp = Derivative(variant("llvm_ad_rgb"), case, 0.02), 8192
    difference = derivative.difference(2 * spp, 5)
    assert derivative.backward(spp, 3) == pytest.approx(difference, rel=0.02)
    assert derivative.forward(spp, 3) == pytest.approx(difference, rel=0.02)


@needs_llvm
@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in GRADIENTS if "glass" in case])
def test_gradients_of_glass(variant, case):
    """The same within 2 %, or twice the standard error, which is of that size: paths through glass are long and bent."""
    derivative = Derivative(variant("llvm_ad_rgb"), case, 0.03)
    assert derivative.forward(512, 3) == pytest.approx(derivative.backward(512, 3), rel=1e-3)
    runs = ((derivative.backward, 2048), (derivative.difference, 4096))
    found = torch.tensor([[run(spp, seed) for seed in range(8)] for run, spp in runs], dtype=torch.float64)
    (prb, difference), stderr = found.mean(-1).tolist(), float(found.var(-1).div(8).sum().sqrt())
    assert stderr < 0.025 * abs(difference)
    assert abs(prb - difference) < 0.02 * abs(difference) + 2 * stderr


@needs_llvm
@pytest.mark.slow
def test_gradients_of_pictures_of_estimates(variant):
    """`path` and `prb` ask for the same random numbers."""
    derivative = Derivative(variant("llvm_ad_rgb"), "metal-exact", 0.02)
    assert derivative.forward(512, 3) == pytest.approx(derivative.backward(512, 3), rel=1e-3)


@needs_llvm
@pytest.mark.slow
def test_gradients_of_estimates(variant):
    """Of a mean of values over places and directions: a picture's difference is noise, as other directions are drawn
    there, for which other random numbers are taken."""
    mi, dr = variant("llvm_ad_rgb"), import_module("drjit")
    bsdf, context = mi.load_dict(METAL | {"distribution": "ggx"} | EXACT | {"max_order": 3}), mi.BSDFContext()
    shown = mi.traverse(bsdf)

    def mean(seed: int, alpha: Any) -> Any:
        shown["alpha.value"] = alpha
        shown.update()
        numbers = mi.PCG32(1 << 20, seed)
        a, b, c = (mi.Point2f(numbers.next_float32(), numbers.next_float32()) for _ in range(3))
        si = dr.zeros(mi.SurfaceInteraction3f, 1 << 20)
        si.wi, wo = mi.warp.square_to_cosine_hemisphere(a), mi.warp.square_to_cosine_hemisphere(b)
        si.p = mi.Point3f(c.x, c.y, 1)
        return dr.mean(dr.sum(bsdf.eval(context, si, wo)) / dr.maximum(wo.z, 1e-3))

    found = []
    for seed in range(12):
        alpha = mi.Float(0.4)
        dr.enable_grad(alpha)
        value = mean(seed, alpha)
        dr.forward(alpha)
        ends = [float(mean(seed, mi.Float(x))[0]) for x in (0.42, 0.38)]
        found.append((float(dr.grad(value)[0]), (ends[0] - ends[1]) / 0.04))
    ours, difference = torch.tensor(found, dtype=torch.float64).unbind(-1)
    stderr = float((ours - difference).std() / math.sqrt(len(found)))
    assert stderr < 0.01 * abs(float(difference.mean()))
    assert abs(float((ours - difference).mean())) < 0.02 * abs(float(difference.mean()))


@needs_llvm
@pytest.mark.slow
def test_roughness_is_found(variant):
    """Steps of Adam through `prb` find the α of a picture; it swings past at first."""
    mi, dr = variant("llvm_ad_rgb"), import_module("drjit")

    def scene(alpha: float) -> Any:
        bsdf = {"type": "torchms_conductor", "material": "Au", "distribution": "ggx", "alpha": alpha}
        return sphere(mi, bsdf, lamp(mi), {"type": "prb", "max_depth": 3}, 16)

    target = mi.render(scene(0.6), spp=2048, seed=9)
    start = scene(0.25)
    shown, key = mi.traverse(start), "ball.bsdf.alpha.value"
    adam = mi.ad.Adam(lr=0.03)
    adam[key] = shown[key]
    shown.update(adam)
    for step in range(90):
        error = dr.mean(dr.square(mi.render(start, shown, spp=64, seed=step) - target), axis=None)
        dr.backward(error)
        adam.step()
        adam[key] = dr.clip(adam[key], 0.03, 1)
        shown.update(adam)
    assert float(shown[key][0]) == pytest.approx(0.6, abs=0.02)
