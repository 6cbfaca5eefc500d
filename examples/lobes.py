"""Where each bounce goes
======================

Draws the lobe of gold in the plane of incidence, bounce by bounce: smooth and rough.

::

    python examples/lobes.py --alpha 0.3 0.8 --theta 50 --out lobes.png

The first bounce leans away from the light. The second is wider and stands nearly upright: light that meets a second facet has
forgotten most of where it came from. At α = 0.3 a seventh of what gold reflects has bounced again, at α = 0.8 nearly half.
"""

import argparse
import math
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import torch
from matplotlib.ticker import MaxNLocator
from torch import Tensor

import torchms as ms
from torchms.fresnel import Conductor

COLOURS = ("#1b6ca8", "#d1495b", "#edae49", "#6a994e")


def plane(n: int = 180) -> tuple[Tensor, Tensor]:
    """Angles from the normal [rad] above the horizon, and the directions (n, 3) of the plane of incidence."""
    angle = torch.linspace(-math.pi / 2, math.pi / 2, n)
    return angle, torch.stack([angle.sin(), torch.zeros(n), angle.cos()], -1)


def orders_of(bsdf: ms.BSDF, theta: float, paths: int) -> tuple[Tensor, Tensor]:
    """Angles, and values [1/sr] of light that left after 1, 2, 3, … bounces, (n, K); the mean over the channels."""
    angle, wo = plane()
    wi = torch.tensor([-math.sin(theta), 0.0, math.cos(theta)])
    with torch.no_grad():
        return angle, bsdf.orders(wi, wo, ms.Stream(seed=1, n_paths=paths)).mean(-1)


def draw(axis: Any, angle: Tensor, orders: Tensor, title: str) -> None:
    """Four orders in polar form, the normal upwards."""
    for k, colour in enumerate(COLOURS):
        label = f"{k + 1} bounce{'s' * (k > 0)}"
        axis.plot(angle, orders[:, k], colour, linewidth=1.6, label=label, linestyle=("-", "--", "-.", ":")[k])
    axis.set_theta_zero_location("N")
    axis.set_theta_direction(-1)
    axis.set_thetalim(-math.pi / 2, math.pi / 2)
    axis.yaxis.set_major_locator(MaxNLocator(3))
    axis.set_title(title)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--alpha", type=float, nargs="+", default=[0.3, 0.8])
    parser.add_argument("--theta", type=float, default=50.0, help="incidence [degrees from the normal]")
    parser.add_argument("--paths", type=int, default=512, help="light paths for each direction")
    parser.add_argument("--out", type=Path, default=Path("lobes.png"))
    parser.add_argument("--force", action="store_true", help="overwrite the picture")
    options = parser.parse_args()
    if options.out.exists() and not options.force:
        parser.error(f"{options.out} exists; --force overwrites it.")
    figure = plt.figure(figsize=(9, 3.2), layout="constrained")
    for i, alpha in enumerate(options.alpha):
        axis = figure.add_subplot(1, len(options.alpha), i + 1, projection="polar")
        gold = ms.RoughConductor(ms.GGX(alpha), Conductor.metal("Au"), ms.Bidirectional(ms.Invariance(), max_order=8))
        angle, orders = orders_of(gold, math.radians(options.theta), options.paths)
        draw(axis, angle, orders, f"gold, α = {alpha:g}, light from {options.theta:g}°")
        peaks = ", ".join(f"{float(x):.3f}" for x in orders.amax(0)[:3])
        wi = torch.tensor([-math.sin(math.radians(options.theta)), 0.0, math.cos(math.radians(options.theta))])
        left = gold.albedo(wi, ms.Stream(seed=2, n_paths=4096)).reflected.mean(-1)
        print(
            f"α = {alpha:g}: lobes up to {peaks} /sr; {100 * float(1 - left[0] / left.sum()):.0f} % has bounced again"
        )
    figure.axes[-1].legend(loc="lower center", bbox_to_anchor=(0.5, -0.1), ncols=4, fontsize=8, frameon=False)
    figure.savefig(options.out, dpi=110)


if __name__ == "__main__":
    main()
