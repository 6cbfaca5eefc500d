"""How good are closed-form compensations? Lobes, energies, colours and cost of every model, side by side.

    python benchmarks/accuracy_lobes.py [--walks 1.5e5] [--rays 2e5] [--cost-only] [--force]

Directional error: root mean square over the hemisphere of the difference of two lobes, in bins of equal solid angle,
over the root mean square of the reference; the references are the invariance model (exact for Smith's theory) and, for
Beckmann, explicit Gaussian surfaces. Noise: the height walk, which differs from invariance by nothing else. `accuracy.py`
has the energies per order against explicit surfaces. Cost: one `forward` with one path, eager, float32.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import torch
import tyro
from record import RESULTS, birth_certificate, seconds
from torch import Tensor

import torchms as ms
from torchms.fresnel import Conductor, Fresnel, Ideal
from torchms.lobes import measure
from torchms.maths.frame import direction
from torchms.microsurface.rays.grid_walk import GridTracer
from torchms.microsurface.simulation.materials import MirrorFacets
from torchms.microsurface.simulation.simulate import simulate
from torchms.microsurface.surfaces.recipe import GaussianSurfaces
from torchms.storage.write import check_writable, write_json

matplotlib.use("Agg")

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
    ("Beckmann", (0.5,)),
    ("Beckmann", (1.0,)),
    ("Beckmann", (1.0, 0.1)),
    ("GGX", (0.25,)),
    ("GGX", (0.5,)),
    ("GGX", (1.0,)),
]
THETAS = (0.5, 1.0, 1.4)
BINS = (16, 16)
METALS = (("Au", 0.5), ("Au", 1.0), ("Cu", 1.0))
IMAGE = Path(__file__).parents[1] / "docs" / "images" / "accuracy.png"


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
    out: Path = RESULTS / "accuracy_lobes.json"
    """Where the numbers go."""
    force: bool = False
    """Overwrite them."""


def bsdf(kind: str, alpha: tuple[float, ...], model: str, fresnel: Fresnel | None = None) -> ms.BSDF:
    return ms.RoughConductor(getattr(ms, kind)(*alpha), fresnel or Ideal(), MODELS[model]())


def upper(lobe: Tensor) -> Tensor:
    """The last plane, all orders, above the horizon: (n_cos / 2, n_phi)."""
    return lobe[-1, lobe.shape[1] // 2 :, :, 0]


def relative(lobe: Tensor, reference: Tensor) -> float:
    return float((lobe - reference).square().mean().sqrt() / reference.square().mean().sqrt())


def lobe_row(kind: str, alpha: tuple[float, ...], theta: float, options: Options) -> dict[str, Any]:
    """Directional and energy errors of all models for one direction of incidence."""
    wi = direction(theta, 0.4, dtype=torch.float32)
    lobes, energy = {}, {}
    for name in MODELS:
        tally = measure(
            bsdf(kind, alpha, name), wi, n_paths=int(options.walks), seed=options.seed, bins=BINS, progress=False
        )
        assert tally.lobes is not None
        lobes[name], energy[name] = upper(tally.lobes.mean), float(tally.total[0])
    row: dict[str, Any] = {"distribution": kind, "alpha": list(alpha), "theta": theta, "energy": energy}
    row["error"] = {name: relative(lobe, lobes["invariance"]) for name, lobe in lobes.items() if name != "invariance"}
    if kind == "Beckmann":
        recipe = GaussianSurfaces(alpha[0], alpha[-1], count=options.surfaces, size=512)
        truth = simulate(
            recipe,
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
        row["error_simulation"] = {name: relative(coarser(lobe, theirs.shape), theirs) for name, lobe in lobes.items()}
        spread = coarser(upper(truth.lobes.stderr) ** 2) / 4
        row["noise_simulation"] = float(spread.mean().sqrt() / theirs.square().mean().sqrt())
    return row


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


def figure(content: dict[str, Any]) -> None:
    """Directional errors, and what gold looks like."""
    import matplotlib.pyplot as plt

    shown = ("single bounce", "Turquin", "Kulla-Conty", "correlated", "uncorrelated", "Distilled", "height walk")
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.2), width_ratios=(1.7, 1))
    labels = [f"{kind}\n{', '.join(f'{a:g}' for a in alpha)}" for kind, alpha in CASES]
    for i, name in enumerate(shown):
        values = []
        for kind, alpha in CASES:
            mine = [r for r in content["lobes"] if r["distribution"] == kind and r["alpha"] == list(alpha)]
            values.append(math.sqrt(sum(r["error"][name] ** 2 for r in mine) / len(mine)))
        axes[0].bar([x + (i - 3) * 0.12 for x in range(len(labels))], values, 0.12, label=name)
    axes[0].set_yscale("log")
    axes[0].set_ylim(3e-3, 3)
    axes[0].set_xticks(range(len(labels)), labels)
    axes[0].set_ylabel("RMS error of the lobe, relative")
    axes[0].set_title("F = 1, against Smith's theory (invariance)", fontsize=10)
    axes[0].legend(fontsize=8, ncols=2)
    axes[0].grid(axis="y", alpha=0.3)
    row = next(r for r in content["metals"] if r["metal"] == "Au" and r["alpha"] == 1.0)
    names = ("single bounce", "Turquin", "Kulla-Conty", "correlated", "uncorrelated", "Distilled", "invariance")
    for c, colour in enumerate(("tab:red", "tab:green", "tab:blue")):
        values = [row["rgb"][name][c] for name in names]
        axes[1].barh([y + (c - 1) * 0.26 for y in range(len(names))], values, 0.26, color=colour)
    axes[1].set_yticks(range(len(names)), names)
    axes[1].set_xlabel("reflected energy, red green blue")
    axes[1].set_title("Gold, GGX α = 1, 0.5 rad", fontsize=10)
    axes[1].grid(axis="x", alpha=0.3)
    figure.tight_layout()
    figure.savefig(IMAGE, dpi=80)


def main(options: Options) -> None:
    check_writable(options.out, options.force)
    if options.cost_only:
        content = json.loads(options.out.read_text())
        content["ns_per_value"], content["birth_of_cost"] = costs(), birth_certificate()
    else:
        command = f"python benchmarks/accuracy_lobes.py --walks {options.walks:g} --rays {options.rays:g}"
        content = {"birth": birth_certificate(), "command": f"{command} --seed {options.seed}"}
        content["metals"] = [metal_row(metal, alpha, options) for metal, alpha in METALS]
        content["lobes"] = []
        for kind, alpha in CASES:
            for theta in THETAS:
                content["lobes"].append(lobe_row(kind, alpha, theta, options))
            print(kind, alpha, {k: f"{v:.4f}" for k, v in content["lobes"][-1]["error"].items()}, flush=True)
    write_json(options.out, content, force=True)
    figure(content)
    for name, times in content.get("ns_per_value", {}).items():
        print(f"{name:28} {times['median']:8.0f} ns")


if __name__ == "__main__":
    main(tyro.cli(Options))
