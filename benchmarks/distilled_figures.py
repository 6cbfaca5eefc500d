"""Pictures of `Distilled`: lobes over the exact ones, and a sphere of two samples a pixel.

    python benchmarks/distilled_figures.py [--out docs/images]

distilled_lobes.png: f cos θ_o in the plane of incidence, F = 1. distilled_sphere.png: gold under a directional light, which
needs no samples itself: what is left of noise is the model's.
"""

import argparse
import math
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import torch
from matplotlib.ticker import MaxNLocator
from torch import Tensor

import torchms as ms
from torchms.cli.options import RenderOptions
from torchms.cli.render import run_render
from torchms.fresnel import Ideal

SURFACES: tuple[tuple[str, tuple[float, ...], float], ...] = (
    ("GGX", (0.5,), 1.0),
    ("GGX", (1.0,), 0.5),
    ("GGX", (1.0, 0.1), 0.5),
    ("Beckmann", (1.0,), 0.5),
)
"""Distribution, roughness and angle of incidence [rad]."""
# Colours of Okabe and Ito; dashes tell the same.
MODELS = {
    "exact": ("0.78", 6.0, "-"),
    "Distilled": ("#0072B2", 1.5, "-"),
    "Kulla–Conty": ("#D55E00", 1.5, "--"),
    "Turquin": ("#009E73", 1.5, "-."),
    "one bounce": ("black", 1.3, ":"),
}
PATHS = 4096
GOLD = "RoughConductor(GGX(1.0), Conductor.metal('Au'), {})"


@torch.no_grad()
def lobes(kind: str, alpha: tuple[float, ...], theta: float, angles: Tensor) -> dict[str, Tensor]:
    """f · cos θ_o [1/sr] of each model in the plane of incidence, at azimuth 0.4 of an anisotropic surface."""

    def at(angle: Tensor) -> Tensor:
        s = torch.sin(angle)
        return torch.stack([s * math.cos(0.4), s * math.sin(0.4), torch.cos(angle)], -1)

    wi = at(torch.tensor(-theta)).expand(len(angles), 3)
    scatterings = {
        "exact": ms.Bidirectional(ms.Invariance(), 12),
        "Distilled": ms.Distilled(),
        "Kulla–Conty": ms.KullaConty(),
        "Turquin": ms.Turquin(),
        "one bounce": ms.SingleBounce(),
    }
    found = {}
    for name, scattering in scatterings.items():
        surface = ms.RoughConductor(getattr(ms, kind)(*alpha), Ideal(), scattering)
        found[name] = surface(wi, at(angles), ms.Stream(1, PATHS))[:, 0]
    return found


def draw_lobes(path: Path) -> None:
    """Polar plots of the surfaces."""
    plt.rcParams.update({"font.size": 11})
    angles = torch.linspace(-math.pi / 2 + 1e-3, math.pi / 2 - 1e-3, 181)
    figure, axes = plt.subplots(2, 2, figsize=(9.5, 6.4), subplot_kw={"projection": "polar"})
    for axis, (kind, alpha, theta) in zip(axes.flat, SURFACES, strict=True):
        for name, value in lobes(kind, alpha, theta, angles).items():
            colour, width, dash = MODELS[name]
            axis.plot(angles, value, color=colour, linewidth=width, linestyle=dash, label=name)
        axis.set_theta_zero_location("N")
        axis.set_theta_direction(-1)
        axis.set_thetalim(-math.pi / 2, math.pi / 2)
        axis.set_thetagrids(range(-90, 91, 30))
        roughness = " × ".join(f"{a:g}" for a in alpha)
        axis.set_title(f"{kind}, α = {roughness}; light from −{math.degrees(theta):.0f}°", fontsize=11, y=0.88)
        axis.tick_params(labelsize=9)
        axis.yaxis.set_major_locator(MaxNLocator(3))
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="lower center", ncols=len(MODELS), frameon=False)
    figure.text(0.5, 0.065, "f cos θ_o [1/sr] over the angle of the outgoing direction; F = 1", ha="center")
    figure.subplots_adjust(left=0.03, right=0.97, wspace=0.12, hspace=-0.1, top=1.01, bottom=0.03)
    figure.savefig(path, dpi=90, pil_kwargs={"optimize": True})
    plt.close(figure)


def draw_spheres(path: Path) -> None:
    """Gold with two samples of one path a pixel, by one bounce, the bidirectional estimator and `Distilled`."""
    models = {
        "one bounce": "SingleBounce()",
        "Bidirectional(Invariance())": "Bidirectional(Invariance())",
        "Distilled()": "Distilled()",
    }
    figure, axes = plt.subplots(1, len(models), figsize=(9.6, 3.4))
    with tempfile.TemporaryDirectory() as folder:
        for axis, (name, scattering) in zip(axes, models.items(), strict=True):
            out = Path(folder) / f"{name[:5].strip()}.png"
            run_render(
                RenderOptions(
                    out=str(out),
                    bsdf=GOLD.format(scattering),
                    scene="sphere",
                    samples=2,
                    width=320,
                    height=320,
                    towards_light=(-0.25, 0.3, 0.9),
                    intensity=4.0,
                    background="black",
                    tone="filmic",
                    force=True,
                )
            )
            axis.imshow(plt.imread(out), interpolation="nearest")
            axis.set_title(name, fontsize=11)
            axis.axis("off")
    figure.subplots_adjust(left=0.01, right=0.99, wspace=0.03, top=0.9, bottom=0.01)
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent.parent / "docs" / "images")
    folder = parser.parse_args().out
    draw_lobes(folder / "distilled_lobes.png")
    draw_spheres(folder / "distilled_sphere.png")
