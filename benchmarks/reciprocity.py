"""[Wang2022] Fig. 16: is ρ(ωi, ωo) = ρ(ωo, ωi)? Difference image and histogram, correlated model beside invariance.

ρ is the BSDF without the cosine: a value over |cos θ_o|. The scene is a sphere with F = 1, GGX, seen and lit from two
directions 60° apart, so that each pixel is one pair; both values of a pixel are means over N independent paths, and their
difference has a standard error. If ρ is reciprocal, it is zero but for that error: in each pixel, in the mean, and in the
mean square, where the errors cannot cancel. The mean alone can be zero for a model that is not reciprocal: on a sphere, the
pairs (ωi, ωo) and (ωo, ωi) lie mirrored about the middle between view and light, and their differences are opposite.
"""

import argparse
import math
from pathlib import Path
from typing import Any

import torch
from record import save
from torch import Tensor

import torchms as ms
from torchms.fresnel import Ideal
from torchms.maths.frame import direction
from torchms.render.paths import shading_point
from torchms.render.shapes import Hits, Sphere
from torchms.sampling.stream import Stream

FIGURE = Path(__file__).parents[1] / "docs" / "images" / "reciprocity.png"
SEGMENTS = {"correlated": ms.Correlated, "invariance": ms.Invariance}
APART = math.radians(60)


def sphere_pixels(size: int) -> tuple[Tensor, Tensor, Tensor]:
    """Index of the pixels, local ωi and ωo (n, 3), of a sphere in parallel projection; both well above the horizon."""
    centre = (torch.arange(size, dtype=torch.float64) + 0.5) / size * 2 - 1
    y, x = torch.meshgrid(-centre, centre, indexing="ij")
    flat = torch.stack([x.reshape(-1), y.reshape(-1)], -1)
    origin = torch.cat([flat, torch.full_like(flat[:, :1], 2.0)], -1)
    down = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64).expand_as(origin)
    hits = Sphere().intersect(origin, down)
    hit = hits.found.nonzero()[:, 0]
    vertex = shading_point(Hits(*(part[hit] for part in hits)), down[hit], True, torch.float32)
    light = direction(APART).expand(len(hit), 3)
    wo = vertex.to_local(light)
    both = (wo[:, 2] > 0.1) & (vertex.wi[:, 2] > 0.1)
    return hit[both], vertex.wi[both], wo[both]


def density(bsdf: ms.BSDF, wi: Tensor, wo: Tensor, paths: int, seed: int) -> tuple[Tensor, Tensor]:
    """Mean of ρ over the paths and the variance of that mean, each (n,)."""
    batches = 8
    values = torch.stack(
        [
            bsdf(wi, wo, Stream(seed * batches + i, max(1, paths // batches)))[..., 0].double() / wo[:, 2].double()
            for i in range(batches)
        ]
    )
    return values.mean(0), values.var(0) / batches


def verdict(row: dict[str, Any]) -> str:
    """What the numbers say."""
    mean = f"mean difference {row['mean']:+.2e} ± {row['mean_stderr']:.1e}"
    zero = "zero within its standard error" if abs(row["mean"]) < 3 * row["mean_stderr"] else "not zero"
    square = f"mean square beyond the noise {row['excess_mean_square']:+.2e} ± {row['excess_stderr']:.1e}"
    other = "none" if abs(row["excess_mean_square"]) < 3 * row["excess_stderr"] else "there is a difference"
    return f"{row['model']}, alpha {row['alpha']}, {row['paths']} paths a pixel: {mean} ({zero}); {square} ({other})"


@torch.no_grad()
def run(size: int, alpha: float, K: int, paths: int) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """A row a model, and what the figure shows."""
    index, wi, wo = sphere_pixels(size)
    rows, shown = [], {"size": size, "index": index}
    for model, segment in SEGMENTS.items():
        bsdf = ms.RoughConductor(ms.GGX(alpha), Ideal(), ms.Bidirectional(segment(), K))
        there, there_variance = density(bsdf, wi, wo, paths, 1)
        back, back_variance = density(bsdf, wo, wi, paths, 2)
        difference, variance = there - back, there_variance + back_variance
        excess = difference**2 - variance
        row = {
            "model": model,
            "alpha": alpha,
            "max_order": K,
            "pixels": len(index),
            "paths": paths,
            "mean_value": float(there.mean()),
            "mean": float(difference.mean()),
            "mean_stderr": float(variance.sum().sqrt() / len(index)),
            "excess_mean_square": float(excess.mean()),
            "excess_stderr": float(excess.std() / math.sqrt(len(index))),
            "largest_relative_difference": float((difference.abs() / there.clamp_min(1e-9)).max()),
        }
        row["verdict"] = verdict(row)
        rows.append(row)
        shown[model] = (difference, variance, there)
        print(row["verdict"], flush=True)
    return rows, shown


def plot(rows: list[dict[str, Any]], shown: dict[str, Any], path: Path) -> None:
    """Difference images over histograms."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    pyplot.rcParams.update({"font.size": 11})
    figure, axes = pyplot.subplots(2, 2, figsize=(9, 7.6), height_ratios=(1.3, 1), layout="constrained")
    limit = max(float(shown[row["model"]][0].abs().quantile(0.995)) for row in rows)
    images = []
    for column, row in enumerate(rows):
        difference, variance, _ = shown[row["model"]]
        picture = torch.full((shown["size"] ** 2,), torch.nan, dtype=torch.float64)
        picture[shown["index"]] = difference
        top, below = axes[0][column], axes[1][column]
        drawn = top.imshow(picture.reshape(shown["size"], -1), cmap="RdBu_r", vmin=-limit, vmax=limit)
        images.append(drawn)
        top.set_title(f"{row['model']}\nmean {row['mean']:+.1e} ± {row['mean_stderr']:.0e}")
        top.axis("off")
        bins = torch.linspace(-limit, limit, 61).numpy()
        below.hist(difference.numpy(), bins, color="#56B4E9", label="difference of a pixel")
        noise = torch.randn(len(difference), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
        below.hist((noise * variance.sqrt()).numpy(), bins, histtype="step", color="black", label="its noise alone")
        below.set_yscale("symlog", linthresh=10)
        below.set_ylim(0, 1.2 * len(difference))
        below.set_xlabel("difference [1/sr]")
        below.set_ylabel("pixels")
    figure.colorbar(images[-1], ax=axes[0], shrink=0.8, label="difference [1/sr]")
    figure.legend(*axes[1][0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    figure.suptitle(
        f"What exchanging light and view changes on a sphere: F = 1, GGX α = {rows[0]['alpha']:g}, "
        f"{rows[0]['paths']} paths a pixel and way",
        fontsize=11,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90, pil_kwargs={"optimize": True})
    pyplot.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=64, help="pixels across and down")
    parser.add_argument("--alpha", type=float, nargs="+", default=[0.5, 1.0], help="the figure shows the last")
    parser.add_argument("--max-order", type=int, default=6)
    parser.add_argument("--paths", type=int, default=512)
    parser.add_argument("--quick", action="store_true", help="few paths; nothing is saved")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.quick:
        run(16, options.alpha[-1], 3, 64)
        return
    found = [run(options.size, alpha, options.max_order, options.paths) for alpha in options.alpha]
    save("reciprocity", [row for rows, _ in found for row in rows])
    plot(*found[-1], FIGURE)


if __name__ == "__main__":
    main()
