"""How good are closed-form compensations? Lobes, energies, colours and cost of every model, side by side.

    python benchmarks/accuracy_lobes.py [--walks 1.5e5] [--rays 2e5] [--cost-only | --figure-only] [--quick] [--force]

Directional error: root mean square over the sphere of the difference of two lobes, in bins of equal solid angle, over the root
mean square of the reference; the references are height walks with a seed of their own (exact for Smith's theory, for glass too)
and, for metal with Beckmann, explicit Gaussian surfaces. Noise: the height walk again. F = 1, albedo 1, η = 1.5. `accuracy.py`
has the energies per order against explicit surfaces. Cost: one `forward` with one path, eager, float32.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
import tyro
from accuracy_figure import IMAGE, draw
from record import RESULTS, birth_certificate, seconds
from torch import Tensor

import torchms as ms
from torchms.fresnel import Conductor, Dielectric, Fresnel, Ideal
from torchms.lobes import Tally, measure
from torchms.maths.frame import direction
from torchms.microsurface.rays.grid_walk import GridTracer
from torchms.microsurface.simulation.materials import MirrorFacets
from torchms.microsurface.simulation.simulate import simulate
from torchms.microsurface.surfaces.recipe import GaussianSurfaces
from torchms.storage.write import check_writable, write_json

K = 10
MODELS: dict[str, Callable[[], ms.Scattering]] = {
    "invariance": lambda: ms.Unidirectional(ms.Invariance(), K),
    "height walk": lambda: ms.HeightWalk(K),
    "uncorrelated": lambda: ms.Unidirectional(ms.Uncorrelated(), K),
    "correlated": lambda: ms.Unidirectional(ms.Correlated(), K),
    "Kulla-Conty": ms.KullaConty,
    "Turquin": ms.Turquin,
    "Distilled": ms.Distilled,
    "single bounce": ms.SingleBounce,
}
CASES = [
    ("metal", "Beckmann", (0.5,)),
    ("metal", "Beckmann", (1.0,)),
    ("metal", "Beckmann", (1.0, 0.1)),
    ("metal", "GGX", (0.25,)),
    ("metal", "GGX", (0.5,)),
    ("metal", "GGX", (1.0,)),
    ("glass", "GGX", (0.25,)),
    ("glass", "GGX", (0.5,)),
    ("glass", "Beckmann", (0.5,)),
    ("diffuse", "GGX", (0.5,)),
    ("diffuse", "GGX", (1.0,)),
    ("diffuse", "Beckmann", (0.5,)),
]
HOLD = {
    "metal": tuple(MODELS),
    "glass": tuple(name for name in MODELS if name != "invariance"),
    "diffuse": tuple(name for name in MODELS if name not in ("Kulla-Conty", "Turquin")),
}
"""The models that hold for a material."""
THETAS = (0.5, 1.0, 1.4)
BINS = (16, 16)
METALS = (("Au", 0.5), ("Au", 1.0), ("Cu", 1.0))


@dataclass
class Options:
    """Compare lobes, colours and cost of the models."""

    walks: float = 1.5e5
    """Random walks a model and direction."""
    rays: float = 2e5
    """Simulated light paths a direction."""
    surfaces: int = 4
    """Independent surfaces of 512² texels."""
    seed: int = 1
    """Seed of everything."""
    cost_only: bool = False
    """Only time the models, and keep the other numbers of the file."""
    figure_only: bool = False
    """Only draw the figure of the file's numbers."""
    quick: bool = False
    """One case a material, one angle, a hundredth of the paths: whether all of it runs; into no file but --out."""
    out: Path = RESULTS / "accuracy_lobes.json"
    """Where the numbers go."""
    force: bool = False
    """Overwrite them."""


def bsdf(kind: str, alpha: tuple[float, ...], model: str, fresnel: Fresnel | None = None) -> ms.BSDF:
    return ms.RoughConductor(getattr(ms, kind)(*alpha), fresnel or Ideal(), MODELS[model]())


def surface_of(material: str, kind: str, alpha: tuple[float, ...], model: str) -> ms.BSDF:
    """Of a material that absorbs nothing."""
    if material == "metal":
        return bsdf(kind, alpha, model)
    make = getattr(ms, kind)(*alpha)
    if material == "glass":
        return ms.RoughDielectric(make, Dielectric(1.5), MODELS[model]())
    return ms.RoughDiffuse(make, 1.0, MODELS[model]())


def every(lobe: Tensor) -> Tensor:
    """The last plane, all orders: (n_cos, n_phi)."""
    return lobe[-1, :, :, 0]


def upper(lobe: Tensor) -> Tensor:
    """What of it lies above the horizon: (n_cos / 2, n_phi)."""
    return every(lobe)[lobe.shape[1] // 2 :]


def relative(lobe: Tensor, reference: Tensor) -> float:
    return float((lobe - reference).square().mean().sqrt() / reference.square().mean().sqrt())


def lobe_row(material: str, kind: str, alpha: tuple[float, ...], theta: float, options: Options) -> dict[str, Any]:
    """Directional and energy errors of all models for one direction of incidence."""
    wi = direction(theta, 0.4, dtype=torch.float32)

    def measured(name: str, seed: int) -> Tally:
        made = surface_of(material, kind, alpha, name)
        return measure(made, wi, n_paths=int(options.walks), seed=seed, bins=BINS, progress=False)

    tallies = {name: measured(name, options.seed) for name in HOLD[material]}
    reference = every(_lobes(measured("height walk", options.seed + 1)))
    row: dict[str, Any] = {"material": material, "distribution": kind, "alpha": list(alpha), "theta": theta}
    row["energy"] = {name: float(tally.total[0]) for name, tally in tallies.items()}
    row["error"] = {name: relative(every(_lobes(tally)), reference) for name, tally in tallies.items()}
    if material == "metal" and kind == "Beckmann":
        row |= against_surfaces(alpha, wi, {name: upper(_lobes(tally)) for name, tally in tallies.items()}, options)
    return row


def _lobes(tally: Tally) -> Tensor:
    assert tally.lobes is not None
    return tally.lobes.mean


def against_surfaces(
    alpha: tuple[float, ...], wi: Tensor, lobes: dict[str, Tensor], options: Options
) -> dict[str, Any]:
    """The same against explicit surfaces."""
    truth = simulate(
        GaussianSurfaces(alpha[0], alpha[-1], count=options.surfaces, size=512),
        MirrorFacets(),
        wi,
        n_rays=options.rays,
        max_order=K,
        seed=options.seed,
        tracer=GridTracer(),
        lobes=True,
    )
    assert truth.lobes is not None
    theirs = coarser(upper(truth.lobes.mean))
    spread = coarser(upper(truth.lobes.stderr) ** 2) / 4
    return {
        "error_simulation": {name: relative(coarser(lobe, theirs.shape), theirs) for name, lobe in lobes.items()},
        "noise_simulation": float(spread.mean().sqrt() / theirs.square().mean().sqrt()),
    }


def coarser(lobe: Tensor, shape: torch.Size | tuple[int, int] = (8, 8)) -> Tensor:
    """Means over bins, (8, 8) of them."""
    rows, columns = lobe.shape[0] // shape[0], lobe.shape[1] // shape[1]
    return lobe.reshape(shape[0], rows, shape[1], columns).mean((1, 3))


def metal_row(metal: str, alpha: float, options: Options) -> dict[str, Any]:
    """What each model reflects in red, green and blue at 0.5 rad."""
    wi = direction(0.5, 0.0, dtype=torch.float32)
    rgb = {}
    for name in MODELS:
        surface = bsdf("GGX", (alpha,), name, Conductor.metal(metal))
        rgb[name] = measure(surface, wi, n_paths=int(options.walks), seed=options.seed, progress=False).total.tolist()
    return {"metal": metal, "alpha": alpha, "theta": 0.5, "rgb": rgb}


def costs(rows: int = 100_000) -> dict[str, Any]:
    """ns a value."""
    generator = torch.Generator().manual_seed(0)
    w = torch.nn.functional.normalize(torch.randn(2, rows, 3, generator=generator), dim=-1)
    w[..., 2] = w[..., 2].abs()
    named = {f"{name}, isotropic": bsdf("GGX", (0.5,), name) for name in MODELS}
    named |= {f"{name}, anisotropic": bsdf("GGX", (0.5, 0.2), name) for name in ("Kulla-Conty", "Turquin")}
    named["bidirectional, isotropic"] = ms.RoughConductor(
        ms.GGX(0.5), Ideal(), ms.Bidirectional(ms.Invariance(), max_order=K)
    )
    found = {}
    with torch.no_grad():
        for name, surface in named.items():
            fixed = surface.scattering.is_deterministic(surface.vertex)
            u = None if fixed else surface.uniforms((rows,), generator=generator)
            times = seconds(lambda s=surface, u=u: s(w[0], w[1], u), repetitions=5)
            found[name] = {key: 1e9 * value / rows for key, value in times.items()}
    return found


def computed(options: Options) -> dict[str, Any]:
    """All numbers but the costs."""
    cases, thetas, metals = CASES, THETAS, METALS
    if options.quick:
        cases, thetas, metals = [CASES[0], CASES[6], CASES[9]], THETAS[:1], METALS[1:2]
        options = replace(options, walks=options.walks / 100, rays=options.rays / 100)
    command = f"python benchmarks/accuracy_lobes.py --walks {options.walks:g} --rays {options.rays:g}"
    content: dict[str, Any] = {"birth": birth_certificate(), "command": f"{command} --seed {options.seed}"}
    content["metals"] = [metal_row(metal, alpha, options) for metal, alpha in metals]
    content["lobes"] = []
    for material, kind, alpha in cases:
        for theta in thetas:
            content["lobes"].append(lobe_row(material, kind, alpha, theta, options))
        print(material, kind, alpha, {k: f"{v:.4f}" for k, v in content["lobes"][-1]["error"].items()}, flush=True)
    return content


def main(options: Options) -> None:
    if not options.figure_only:
        check_writable(options.out, options.force or options.cost_only)
    if options.cost_only or options.figure_only:
        content = json.loads(options.out.read_text())
        if options.cost_only:
            content["ns_per_value"], content["birth_of_cost"] = costs(), birth_certificate()
    else:
        content = computed(options)
    if not options.figure_only:
        write_json(options.out, content, force=True)
    draw(content, options.out.with_suffix(".png") if options.quick else IMAGE)
    for name, times in content.get("ns_per_value", {}).items():
        print(f"{name:28} {times['median']:8.0f} ns")


if __name__ == "__main__":
    main(tyro.cli(Options))
