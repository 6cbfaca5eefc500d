"""[Wang2022] Fig. 17: how fast do the estimators converge? Mean square error against time on the Single Slab.

The slab (0.7 × 1.4 × 0.04, turned 110° about x and 45° about y, seen from (1.5, 1.5, 1.5), fov 45°) is a conductor with
F = 1, GGX, lit by one direction; each pixel's centre is one pair (wi, wo), and a picture is one call of the BSDF with N
paths for all pixels that show the slab. An estimator's reference is the converged picture of the same model, so the curves
are noise alone. What the correlated model differs from the Smith model by, which no number of samples removes, is a line of
its own: the mean square of converged correlated − converged invariance. One thread; random numbers are part of the time.
"""

import argparse
import math
import time
from pathlib import Path
from typing import Any, NamedTuple

import torch
from record import save
from torch import Tensor

import torchms as ms
from torchms.fresnel import Ideal
from torchms.render.lights import DirectionalLight
from torchms.render.paths import shading_point
from torchms.render.scenes import load_shape
from torchms.render.shapes import Hits
from torchms.sampling.stream import Stream

ALPHAS = (0.1, 0.3, 0.5, 0.7, 1.0)
TOWARDS_LIGHT = (-0.3, 1.0, 0.1)
FIGURE = Path(__file__).parents[1] / "docs" / "images" / "convergence.png"

SEGMENTS = {"correlated": ms.Correlated, "invariance": ms.Invariance}


def estimators(K: int) -> dict[str, tuple[str, ms.Scattering]]:
    """Name → (model, scattering)."""
    found: dict[str, tuple[str, ms.Scattering]] = {}
    for model, segment in SEGMENTS.items():
        found[f"bidirectional, {model}"] = (model, ms.Bidirectional(segment(), K))
        found[f"unidirectional, {model}"] = (model, ms.Unidirectional(segment(), K))
    found["height walk"] = ("invariance", ms.HeightWalk(K))
    return found


def slab_pixels(size: int) -> tuple[Tensor, Tensor]:
    """Local wi and wo (n, 3) at the centres of the pixels that show the slab, lit side only."""
    shape, camera = load_shape("slab")
    centre = (torch.arange(size) + 0.5) / size
    y, x = torch.meshgrid(centre, centre, indexing="ij")
    origin, direction = camera.rays(x.reshape(-1), y.reshape(-1), 1.0)
    hits = shape.intersect(origin, direction)
    hit = hits.found.nonzero()[:, 0]
    vertex = shading_point(Hits(*(part[hit] for part in hits)), direction[hit], True, torch.float32)
    towards = DirectionalLight(TOWARDS_LIGHT).towards.expand(len(hit), 3)
    wo = vertex.to_local(towards)
    lit = wo[:, 2] > 0
    return vertex.wi[lit], wo[lit]


def timed(bsdf: ms.BSDF, wi: Tensor, wo: Tensor, paths: int, seed: int) -> tuple[Tensor, float]:
    """A picture (n,) and the processor time it took [s]: with one thread other programs add next to nothing to it."""
    start = time.process_time()
    value = bsdf(wi, wo, bsdf.uniforms((len(wi),), paths, generator=torch.Generator().manual_seed(seed)))
    return value[..., 0].double(), time.process_time() - start


class Reference(NamedTuple):
    """Converged picture (n,) and the variance of its pixels (n,)."""

    mean: Tensor
    variance: Tensor


def reference(bsdf: ms.BSDF, wi: Tensor, wo: Tensor, paths: int) -> Reference:
    """Mean over 16 pictures of a sixteenth of the paths, random numbers of their own."""
    pictures = torch.stack(
        [bsdf(wi, wo, Stream((1 << 20) + i, max(1, paths // 16)))[..., 0].double() for i in range(16)]
    )
    return Reference(pictures.mean(0), pictures.var(0) / 16)


def curve(bsdf: ms.BSDF, wi: Tensor, wo: Tensor, truth: Reference, counts: list[int], repeats: int) -> dict[str, Any]:
    """Error and time for each number of paths, means over `repeats` pictures."""
    timed(bsdf, wi, wo, 1, 0)
    mse, spread, seconds = [], [], []
    for paths in counts:
        runs = [timed(bsdf, wi, wo, paths, 1 + i) for i in range(repeats)]
        # The reference is independent of the picture: its own variance is in the difference, and is taken off.
        errors = torch.stack([((picture - truth.mean) ** 2 - truth.variance).mean() for picture, _ in runs])
        mse.append(float(errors.mean()))
        spread.append(float(errors.std() / math.sqrt(repeats)) if repeats > 1 else None)
        seconds.append(sorted(t for _, t in runs)[repeats // 2])
    return {"paths": counts, "mse": mse, "mse_stderr": spread, "seconds": seconds}


@torch.no_grad()
def run(size: int, K: int, counts: list[int], repeats: int, reference_paths: int, quick: bool) -> list[dict[str, Any]]:
    """One row an α: curves of all estimators and the bias of the correlated model."""
    wi, wo = slab_pixels(size)
    rows = []
    for alpha in ALPHAS[1::2] if quick else ALPHAS:

        def surface(scattering: ms.Scattering, alpha: float = alpha) -> ms.BSDF:
            return ms.RoughConductor(ms.GGX(alpha), Ideal(), scattering)

        truths = {
            model: reference(surface(ms.Bidirectional(segment(), K)), wi, wo, reference_paths)
            for model, segment in SEGMENTS.items()
        }
        power = float((truths["invariance"].mean ** 2).mean())
        difference = truths["correlated"].mean - truths["invariance"].mean
        noise = truths["correlated"].variance + truths["invariance"].variance
        row = {
            "alpha": alpha,
            "pixels": len(wi),
            "max_order": K,
            "reference_paths": reference_paths,
            "mean_square": power,
            "reference_mse": {model: float(truth.variance.mean()) for model, truth in truths.items()},
            "correlated_bias_mse": float((difference**2 - noise).mean()),
            "correlated_bias_mean": float(difference.mean()),
            "correlated_bias_mean_stderr": float(noise.sum().sqrt() / len(wi)),
            "curves": {
                name: curve(surface(scattering), wi, wo, truths[model], counts, repeats)
                for name, (model, scattering) in estimators(K).items()
            },
        }
        row["mse_times_seconds"] = {name: product(found) for name, found in row["curves"].items()}
        rows.append(row)
        print(summary(row), flush=True)
    return rows


def product(found: dict[str, Any]) -> float:
    """Error × time, the geometric mean along the curve: what an estimator of independent paths keeps constant."""
    logs = [math.log(m * t) for m, t in zip(found["mse"], found["seconds"], strict=True) if m > 0]
    return math.exp(sum(logs) / len(logs)) if logs else math.nan


def summary(row: dict[str, Any]) -> str:
    """Error × time of each estimator over that of the height walk; smaller is better."""
    base = row["mse_times_seconds"]["height walk"]
    cells = "  ".join(f"{name}: {value / base:.2f}" for name, value in row["mse_times_seconds"].items())
    bias = row["correlated_bias_mse"] / row["mean_square"]
    return f"alpha {row['alpha']}: error x time over the height walk's: {cells}; relative squared bias {bias:.1e}"


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """A panel an α; relative error, both axes logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    # Colours of Okabe and Ito; dashes tell the estimators apart.
    colours = {"correlated": "#D55E00", "invariance": "#0072B2", "height walk": "black"}
    pyplot.rcParams.update({"font.size": 10})
    figure, axes = pyplot.subplots(2, 3, figsize=(9, 6), layout="constrained")
    for axis, row in zip(axes.flat, rows, strict=False):
        for name, found in row["curves"].items():
            kind, _, model = name.partition(", ")
            error = [m / row["mean_square"] for m in found["mse"]]
            style = {"bidirectional": "-", "unidirectional": "--"}.get(kind, ":")
            axis.loglog(found["seconds"], error, style, color=colours[model or kind], marker=".", label=name)
        bias = row["correlated_bias_mse"] / row["mean_square"]
        axis.axhline(bias, color="#CC79A7", lw=2, label="squared bias of correlated")
        axis.set_title(f"α = {row['alpha']:g}")
        axis.grid(True, alpha=0.3)
    for axis in axes.flat[len(rows) :]:
        axis.axis("off")
    axes.flat[-1].legend(*axes.flat[0].get_legend_handles_labels(), loc="center", frameon=False)
    figure.supxlabel("time of a picture, one thread [s]", fontsize=10)
    figure.supylabel("mean square error / mean square", fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True})
    pyplot.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=80, help="pixels across and down")
    parser.add_argument("--max-order", type=int, default=8)
    parser.add_argument("--reference-paths", type=int, default=1024)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="two α, few paths; nothing is saved")
    parser.add_argument("--plot-only", action="store_true", help="draw the figure from the saved numbers")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.plot_only:
        import json

        from record import HOME

        plot(json.loads((HOME / "convergence.json").read_text())["rows"], FIGURE)
        return
    if options.quick:
        run(32, 4, [1, 4], 2, 64, quick=True)
        return
    counts = [1, 2, 4, 8, 16, 32]
    rows = run(options.size, options.max_order, counts, options.repeats, options.reference_paths, quick=False)
    save("convergence", rows)
    plot(rows, FIGURE)


if __name__ == "__main__":
    main()
