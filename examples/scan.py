"""From a scan to a surface
========================

The slopes of real ground, as a distribution and as a Gaussian, and the light both give back.

::

    python examples/scan.py --out scan.png
    python examples/scan.py --file mine.x3p --steeper 1 --out mine.png

Prints the energies of a perfect mirror of that shape, order by order: rays on its facets, Smith's model with the
slopes that it has, and with those of a Gaussian (Beckmann) surface of the same roughness. Without a file it takes the
height map of ground that comes with matplotlib, 3.4 times as steep as it is, which makes alpha 1.
"""
# sphinx_gallery_thumbnail_path = "images/scan.png"

import argparse
import math
import warnings
from pathlib import Path

import numpy as np
import torch
from matplotlib import cbook
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

import torchms as ms
from torchms.fresnel import Ideal
from torchms.lobes import Tally, measure
from torchms.microsurface import Heightfield, MirrorFacets, simulate
from torchms.slopes.heights import facet_slopes

DEGREE = 111_195.0
"""Metres in a degree of latitude."""
ANGLES = (0.0, 0.8, 1.3)
ORDERS = 4


def ground() -> tuple[np.ndarray, tuple[float, float]]:
    """Heights [m] of the Jacksboro fault, Tennessee, x to the east, and the distance between them [m]."""
    with np.load(str(cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False))) as found:
        north = DEGREE * float(found["dy"])
        east = DEGREE * float(found["dx"]) * math.cos(math.radians(float(found["ymin"] + found["ymax"]) / 2))
        return found["elevation"].astype(np.float64)[::-1].T, (east, north)


def scanned(file: Path | None, steeper: float) -> Heightfield:
    """The surface of the file, or of the ground, with its heights multiplied."""
    with warnings.catch_warnings():  # that the ground is coarsely sampled: its facets are taken as they are
        warnings.simplefilter("ignore")
        if file is not None:
            return Heightfield.from_file(file, height_scale=steeper)
        heights, spacing = ground()
        return Heightfield.from_heights(steeper * heights, spacing)


def energies(surface: Heightfield, models: dict[str, ms.BSDF], theta: float, n: int) -> dict[str, Tally]:
    """What leaves after each bounce: of rays on the facets, and of each model."""
    wi = torch.tensor([math.sin(theta) * math.cos(0.4), math.sin(theta) * math.sin(0.4), math.cos(theta)])
    found = {"rays": simulate(surface, MirrorFacets(), wi, n_rays=n, max_order=16, seed=1)}
    return found | {name: measure(model, wi, n_paths=n, seed=2) for name, model in models.items()}


def draw_slopes(axes: Axes, surface: Heightfield, tabulated: ms.Tabulated) -> None:
    """Along x, the densities of the slopes: counted, of the mixture, and of a Gaussian of the same variance."""
    slopes = facet_slopes(surface.heights, surface.spacing, periodic=True)[:, 0]
    rms = slopes.std()
    x = np.linspace(-5, 5, 201) * rms
    axes.hist(slopes, x[::2], density=True, color="0.8", label="facets")
    weights, means, covariances = tabulated.mixture
    sigma = np.sqrt(covariances[:, 0, 0])
    each = np.exp(-0.5 * ((x[:, None] - means[:, 0]) / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
    axes.plot(x, each @ weights, label=f"Tabulated, {len(weights)} components")
    axes.plot(x, np.exp(-0.5 * (x / rms) ** 2) / (rms * math.sqrt(2 * math.pi)), "--", label="Beckmann")
    axes.set(yscale="log", ylim=(1e-4 / rms, 1 / rms), xlabel="slope along x", ylabel="density", title="slopes")
    axes.legend(loc="lower right")


def draw_energies(axes: Axes, found: dict[str, Tally], theta: float) -> None:
    """By order: how far each model is from the rays."""
    k = np.arange(1, ORDERS + 1)
    rays = found["rays"].reflected[:ORDERS, 0].numpy()
    for i, (name, tally) in enumerate((n, t) for n, t in found.items() if n != "rays"):
        error = tally.reflected[:ORDERS, 0].numpy() - rays
        axes.bar(k + 0.4 * i - 0.2, error, 0.4, color=f"C{i}", label=f"Smith, {name}")
    axes.errorbar(
        k, 0 * k, found["rays"].reflected_stderr[:ORDERS, 0].numpy() * 3, fmt="k.", label="rays, 3 standard errors"
    )
    axes.axhline(0, color="k", lw=0.8)
    axes.set(
        xticks=k, xlabel="bounces", ylabel="energy - that of rays", title=f"{math.degrees(theta):.0f}° from the normal"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--file", type=Path, help="a height map that says its units; the ground if none is given")
    parser.add_argument("--steeper", type=float, default=3.4, help="factor of the heights")
    parser.add_argument("--rays", type=float, default=4e5, help="light paths at each angle")
    parser.add_argument("--components", type=int, default=16)
    parser.add_argument("--out", type=Path, default=Path("scan.png"))
    options = parser.parse_args()

    surface = scanned(options.file, options.steeper)
    tabulated = surface.distribution(options.components)
    ax, ay = surface.alpha
    print(
        f"{surface.shape[0]} x {surface.shape[1]} texels, alpha {ax:.3f} x {ay:.3f}, {tabulated.table.shape[1]} components"
    )
    models: dict[str, ms.BSDF] = {
        "Tabulated": ms.RoughConductor(tabulated, Ideal(), ms.HeightWalk(ORDERS + 4)),
        "Beckmann": ms.RoughConductor(ms.Beckmann(ax, ay), Ideal(), ms.HeightWalk(ORDERS + 4)),
    }
    figure, axes = plt.subplots(1, 1 + len(ANGLES), figsize=(16, 4), constrained_layout=True)
    draw_slopes(axes[0], surface, tabulated)
    for panel, theta in zip(axes[1:], ANGLES, strict=True):
        found = energies(surface, models, theta, int(options.rays))
        draw_energies(panel, found, theta)
        for name, tally in found.items():
            numbers = zip(tally.reflected[:ORDERS, 0], tally.reflected_stderr[:ORDERS, 0], strict=True)
            print(f"theta {theta:.1f}  {name:9s}", "  ".join(f"{float(e):.4f} ± {float(s):.4f}" for e, s in numbers))
    axes[1].legend(loc="lower right")
    figure.savefig(options.out, dpi=90)
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
