"""Inverse rendering: find the α map and the Fresnel numbers of gold and of glass from pictures under known lights.

The targets are rendered by the height walk [Heitz2016]. Gold is fitted by another estimator, the position-free one with the
invariance principle, glass by height walks with other random numbers. Each step takes fresh numbers, and the squared error of
an expectation as the product of two independent ones, (f − t)(f' − t), whose gradient is unbiased; Adam does the rest. Then
gold by `Distilled`, compiled, which has no noise and needs one value; and both with single bounces only, which is what
rendering without multiple bounces would find.

`make demo-fit` runs it: a table, results/fit.json and docs/images/fit.png.
"""

import argparse
import math
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import torch
from fit_scene import GBuffer, Material, alpha_map, f0_of, g_buffer, materials, radiance, textured
from record import save
from rich.console import Console
from rich.table import Table
from torch import Tensor, nn

import torchms as ms
from torchms.cli.progress import progress_bar

ROOT = Path(__file__).resolve().parent.parent


class Rows(NamedTuple):
    """One row for each pixel and light that shines on it: point (n,) of the G-buffer, wi, wo (n, 3), uv (n, 2)."""

    point: Tensor
    light: Tensor
    wi: Tensor
    wo: Tensor
    uv: Tensor


def rows_of(g: GBuffer) -> Rows:
    point, light = g.lit.nonzero(as_tuple=True)
    return Rows(point, light, g.wi[point], g.wo[point, light], g.uv[point])


def parameter(module: nn.Module, name: str) -> Tensor:
    value = getattr(module, name)
    assert isinstance(value, Tensor)
    return value


class Surface(nn.Module):
    """What is fitted: an α texture and the Fresnel numbers, each in its range; a scattering that stays."""

    def __init__(self, material: Material, scattering: ms.Scattering) -> None:
        super().__init__()
        self.material, self.scattering = material, scattering
        self.facets = ms.constrain(ms.GGX(torch.full_like(alpha_map(), 0.3)), "alpha", low=0.03, high=1.0)
        self.fresnel = material.module()

    @property
    def alpha(self) -> Tensor:
        return parameter(self.facets, "alpha")

    @property
    def numbers(self) -> Tensor:
        return parameter(self.fresnel, self.material.name)

    def radiance(self, rows: Rows, u: ms.Stream) -> Tensor:
        alpha = textured(self.alpha, rows.uv)
        return radiance(self.material, alpha, self.numbers, self.scattering, rows.wi, rows.wo, u)


def some(rows: Rows, index: Tensor) -> Rows:
    return Rows(*(part[index] for part in rows))


@torch.no_grad()
def photographed(material: Material, rows: Rows, seed: int, n_paths: int) -> Tensor:
    """The target (n, C), by the height walk."""
    u = ms.Stream(seed, n_paths, "sobol")
    return radiance(material, textured(alpha_map(), rows.uv), material.truth, material.target, rows.wi, rows.wo, u)


def noise(material: Material, rows: Rows, target: Tensor, n_paths: int) -> float:
    """Median relative standard error of the target, from 500 of its rows once more."""
    index = torch.randperm(len(target), generator=torch.Generator().manual_seed(4))[:500]
    difference = photographed(material, some(rows, index), 2, n_paths) / target[index] - 1
    return float(difference.abs().median() / (0.6745 * math.sqrt(2)))


def fit(material: Material, scattering: ms.Scattering, rows: Rows, target: Tensor, options: Any, title: str) -> Any:
    """The fitted surface, its first state, and the loss of every step."""
    surface = Surface(material, scattering)
    first = {k: v.clone() for k, v in surface.state_dict().items()}
    optimizer = torch.optim.Adam(surface.parameters(), lr=0.1, betas=(0.9, 0.99))
    # Steps of an optimizer on noisy gradients wander about the optimum: their mean over the second half is nearer to it.
    mean = torch.optim.swa_utils.AveragedModel(surface)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, options.steps, eta_min=1e-3)
    # Relative errors, so that highlights do not decide alone. The scale is smoothed: were it the target's own noise, the
    # weights would favour what happens to be dark.
    scale = 1 / (target + target.mean()).square()
    generator = torch.Generator().manual_seed(3)
    losses = []
    noiseless = isinstance(scattering, ms.Distilled | ms.SingleBounce)
    with progress_bar(title, options.steps) as advance:
        for step in range(options.steps):
            batch = torch.randint(len(target), (options.batch,), generator=generator)
            seed = 10_000 + 2 * step
            n = 1 if noiseless else 2
            errors = [surface.radiance(some(rows, batch), ms.Stream(seed + i)) - target[batch] for i in range(n)]
            loss = (errors[0] * errors[-1] * scale[batch]).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            losses.append(loss.item())
            if step >= options.steps // 2:
                mean.update_parameters(surface)
            advance(1)
    surface.load_state_dict({k.removeprefix("module."): v for k, v in mean.state_dict().items() if k != "n_averaged"})
    return surface, first, torch.tensor(losses)


def seen_texels(rows: Rows) -> Tensor:
    """Which texels the rows depend on by the weight of thirty at least (R, C)."""
    texture = torch.zeros_like(alpha_map()).requires_grad_()
    (weight,) = torch.autograd.grad(textured(texture, rows.uv).sum(), texture)
    return weight > 30


def errors_of(name: str, surface: Surface, seen: Tensor) -> dict[str, float]:
    """α: mean and rms relative error and mean bias over the seen texels; F0: largest error."""
    relative = ((surface.alpha.detach() - alpha_map()) / alpha_map())[seen]
    f0 = f0_of(name, surface.numbers.detach()) - f0_of(name, surface.material.truth)
    worst = f0.reshape(-1)[f0.abs().reshape(-1).argmax()]
    return {
        "alpha_bias": float(relative.mean()),
        "alpha_mean_abs": float(relative.abs().mean()),
        "alpha_rms": float(relative.square().mean().sqrt()),
        "f0_error": float(worst),
        "number_error": float((surface.numbers.detach() - surface.material.truth).abs().max()),
    }


def picture(g: GBuffer, rows: Rows, values: Tensor, size: int, exposure: float = 1.0) -> Tensor:
    """The sum over the lights, linear (size, size, 3); the background is grey."""
    image = torch.full((size * size, 3), 0.12)
    total = torch.zeros(len(g.pixel), 3).index_add_(0, rows.point, values.expand(-1, 3))
    shaded = g.lit.any(1)
    image[g.pixel[shaded]] = total[shaded] * exposure
    return image.reshape(size, size, 3)


def run(name: str, options: argparse.Namespace) -> tuple[dict[str, Any], dict[str, Any]]:
    """The numbers of one material, and what its pictures are made of."""
    torch.set_num_threads(1)
    material = materials()[name]
    g = g_buffer(options.size, inside=name == "glass")
    rows = rows_of(g)
    seen = seen_texels(rows)
    start = time.perf_counter()
    target = photographed(material, rows, 1, options.target_paths)
    row: dict[str, Any] = {
        "material": name,
        "rows": len(target),
        "texels": int(seen.sum()),
        "target_seconds": time.perf_counter() - start,
        "target_noise": noise(material, rows, target, options.target_paths),
        "truth": material.truth.tolist(),
    }
    brightest = torch.zeros(len(g.pixel), 3).index_add_(0, rows.point, target.expand(-1, 3)).quantile(0.98)
    exposure = 0.95 / float(brightest)
    shown: dict[str, Any] = {"seen": seen, "target": picture(g, rows, target, options.size, exposure)}
    models = {"all bounces": material.fitted, "single bounce": ms.SingleBounce()}
    if name == "gold":
        models["distilled"] = ms.Distilled()
    for model, scattering in models.items():
        start = time.perf_counter()
        surface, first, losses = fit(material, scattering, rows, target, options, f"{name}, {model}")
        row[model] = {
            "seconds": time.perf_counter() - start,
            "found": surface.numbers.tolist(),
            **errors_of(name, surface, seen),
            "first_loss": float(losses[:10].mean()),
            "last_loss": float(losses[-100:].mean()),
        }
        shown[model] = {"alpha": surface.alpha.detach().clone(), "losses": losses}
        for state in ("last", "first"):
            if state == "first":
                surface.load_state_dict(first)
            with torch.no_grad():
                values = surface.radiance(rows, ms.Stream(7, 32, "sobol"))
            shown[model][state] = picture(g, rows, values, options.size, exposure)
    return row, shown


def report(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Fit: errors against the truth")
    for column in ("material", "model", "α: mean |error|", "α: bias", "F0: worst error", "numbers found", "truth", "s"):
        table.add_column(column, justify="right")
    for row in rows:
        for model in (m for m in ("all bounces", "distilled", "single bounce") if m in row):
            r = row[model]
            found, truth = (
                ", ".join(f"{x:.3f}" for x in (v if isinstance(v, list) else [v])) for v in (r["found"], row["truth"])
            )
            table.add_row(
                row["material"],
                model,
                f"{100 * r['alpha_mean_abs']:.2f} %",
                f"{100 * r['alpha_bias']:+.2f} %",
                f"{r['f0_error']:+.4f}",
                found,
                truth,
                f"{r['seconds']:.0f}",
            )
    Console().print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=64, help="pixels across and down")
    parser.add_argument("--target-paths", type=int, default=192)
    parser.add_argument("--steps", type=int, default=800)
    parser.add_argument("--batch", type=int, default=4000, help="pixels × lights a step")
    parser.add_argument("--materials", nargs="+", default=list(materials()))
    parser.add_argument("--quick", action="store_true", help="a few steps, nothing is written")
    options = parser.parse_args()
    if options.quick:
        options.steps, options.target_paths = 20, 8
    # A process each: the kernels are too small to be worth sharing.
    with ProcessPoolExecutor(len(options.materials), get_context("spawn")) as pool:
        done = list(pool.map(run, options.materials, [options] * len(options.materials)))
    report([row for row, _ in done])
    if not options.quick:
        from fit_figure import draw

        save("fit", [row for row, _ in done])
        path = ROOT / "docs" / "images" / "fit.png"
        draw({row["material"]: shown for row, shown in done}, alpha_map(), path)
        print(f"{path.relative_to(ROOT)}: {math.ceil(path.stat().st_size / 1024)} KB")


if __name__ == "__main__":
    main()
