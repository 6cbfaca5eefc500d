"""[Wang2022] Figs. 4-15 anew: lobes in the plane of incidence per bounce, simulation against the four models."""

import io
import math
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchms.bsdfs.named import material_of
from torchms.cli.arguments import check_angles, parse_count
from torchms.cli.description import described, exactly_described
from torchms.cli.options import FiguresOptions
from torchms.cli.simulate import TRACERS
from torchms.distributions.base import EllipticDistribution
from torchms.extras import missing
from torchms.fresnel import Dielectric
from torchms.lobes import Tally
from torchms.microsurface.rays.tracer import Tracer
from torchms.microsurface.simulation.comparison import SIMULATION, Case, energies, plane_of_incidence
from torchms.microsurface.simulation.parts import surfaces_of
from torchms.storage.write import check_writable, write_json, write_whole

BOUNCES = ("k = 1", "k = 2", "k = 3", "k ≥ 4")
LEAST = 1e-3
"""Of the light: a panel of less would show the noise of the simulation."""
# Okabe-Ito colours, told apart by everyone; dashes tell them apart in print.
STYLE: dict[str, dict[str, Any]] = {
    SIMULATION: dict(color="black", linewidth=1.4),
    "height walk": dict(color="#D55E00", linewidth=1.2),
    "uncorrelated": dict(color="#0072B2", linewidth=1.2, linestyle="--"),
    "correlated": dict(color="#009E73", linewidth=1.2, linestyle="-."),
    "invariance": dict(color="#CC79A7", linewidth=1.6, linestyle=":"),
}


def run_figures(options: FiguresOptions) -> list[Path]:
    """Draw one figure as PNG and SVG with its numbers as JSON beside it, and return the three paths.

    Raises ValueError or OSError with a message for the user, before the work begins.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise missing("torchms figures", "matplotlib") from error
    rays, walks = parse_count(options.rays, "--rays", 1), parse_count(options.walks, "--walks", 2)
    for theta in options.theta:
        check_angles(theta, options.phi)
    tracer = TRACERS[options.tracer]()
    tracer.require()
    cases = cases_of(options)
    alpha = cases[0].alpha
    name = f"{cases[0].material}_a{alpha[0]:g}" + (f"_{alpha[1]:g}" if alpha[1] != alpha[0] else "")
    if not options.out.exists():
        options.out.mkdir(parents=True)
    paths = [options.out / f"{name}.{suffix}" for suffix in ("png", "svg", "json")]
    for path in paths:
        check_writable(path, options.force)
    results = [compare(case, options, rays, walks, tracer) for case in cases]
    content = {
        "material": cases[0].material,
        "alpha": list(alpha),
        "phi": options.phi,
        "eta": cases[0].eta if cases[0].material == "dielectric" else None,
        "rays": rays,
        "walks": walks,
        "surfaces": options.surfaces,
        "seed": options.seed,
        "panels": [numbers(case, result) for case, result in zip(cases, results, strict=True)],
    }
    with matplotlib.rc_context({"svg.hashsalt": name, "font.size": 8}):
        figure = draw(cases, results)
        for path in paths[:2]:
            buffer = io.BytesIO()
            # No date in the file: the same numbers make the same bytes.
            metadata = {"Date": None} if path.suffix == ".svg" else {}
            figure.savefig(buffer, format=path.suffix[1:], dpi=130, metadata=metadata)
            write_whole(path, buffer.getvalue(), options.force)
    write_json(paths[2], content, options.force)
    print("\n".join(str(path) for path in paths))
    return paths


def cases_of(options: FiguresOptions) -> list[Case]:
    """A column each; ValueError for a surface whose normals are not Beckmann's."""
    exact = exactly_described(options)
    surfaces_of(exact.distribution)
    assert isinstance(exact.distribution, EllipticDistribution)
    # Numbers as they were written: to float64 they are the same again.
    ax, ay = (float(a) for a in exact.distribution.alphas)
    material = material_of(exact)
    fresnel = getattr(exact, "fresnel", None)
    eta = float(fresnel.eta) if isinstance(fresnel, Dielectric) and material == "dielectric" else options.index
    usual = options.bsdf is None and options.metal is None and options.facet_albedo == 1
    bsdf = None if usual else described(options)
    return [Case(material, (ax, ay), theta, options.phi, eta, options.max_order, bsdf) for theta in options.theta]


def compare(case: Case, options: FiguresOptions, rays: int, walks: int, tracer: Tracer) -> dict[str, Tally]:
    """Simulation and models of one column."""
    found = {SIMULATION: case.simulated(options.surfaces, options.size, rays, options.seed, tracer)}
    for model in case.models:
        found[model] = case.modelled(model, walks, options.seed)
    return found


def numbers(case: Case, result: dict[str, Tally]) -> dict[str, Any]:
    """Everything that one column of the figure shows."""
    out: dict[str, Any] = {"theta": case.theta, "models": {}}
    for name, tally in result.items():
        angle, value, error = plane_of_incidence(tally, case.phi)
        out["angle"] = angle.tolist()
        out["models"][name] = energies(tally) | {
            "value": dict(zip((*BOUNCES, "all"), value.tolist(), strict=True)),
            "stderr": dict(zip((*BOUNCES, "all"), error.tolist(), strict=True)),
        }
    return out


def share(tally: Tally, row: int) -> tuple[float, float]:
    """E_r, E_t of a row of the figure."""
    orders = slice(row, row + 1) if row < 3 else slice(3, None)
    return tally.reflected[orders, 0].sum().item(), tally.transmitted[orders, 0].sum().item()


def draw(cases: list[Case], results: list[dict[str, Tally]]) -> Any:
    """The figure: a row a bounce, a column an angle of incidence; where next to nothing leaves no panel, no row of none."""
    from matplotlib.figure import Figure

    rows = [
        i for i in range(len(BOUNCES)) if any(sum(share(result[SIMULATION], i)) >= LEAST for result in results)
    ] or [0]
    figure = Figure(figsize=(3.6 * len(cases), 0.7 + 2.7 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), len(cases), squeeze=False)
    for column, (case, result) in enumerate(zip(cases, results, strict=True)):
        curves = {name: plane_of_incidence(tally, case.phi) for name, tally in result.items()}
        for ax, row in zip(axes[:, column], rows, strict=True):
            shares = {name: share(tally, row) for name, tally in result.items()}
            _panel(ax, row, case.material == "dielectric", curves, shares)
        axes[0, column].set_title(f"$\\theta_i$ = {math.degrees(case.theta):.3g}°")
    for ax, row in zip(axes[:, 0], rows, strict=True):
        ax.set_ylabel(f"{BOUNCES[row]}      f · |cos θ$_o$| [1/sr]")
    for ax in axes[-1]:
        ax.set_xlabel("angle in the plane of incidence [°]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    ax_, ay_ = cases[0].alpha
    kind = {
        "conductor": "conductor, F = 1",
        "dielectric": f"dielectric, η = {cases[0].eta:g}",
        "diffuse": "diffuse, ρ = 1",
    }
    through = ", 180° is straight through" if cases[0].material == "dielectric" else ""
    surface = f"Beckmann α = {ax_:g}" + (f" × {ay_:g}" if ax_ != ay_ else "")
    figure.suptitle(f"{kind[cases[0].material]}, {surface}; the mirror direction is at an angle > 0{through}")
    return figure


def _panel(
    ax: Any,
    row: int,
    transmits: bool,
    curves: dict[str, tuple[Tensor, Tensor, Tensor]],
    shares: dict[str, tuple[float, float]],
) -> None:
    """The lobes of one order, and beside each model's name the energy that leaves on either side."""
    if sum(shares[SIMULATION]) < LEAST:
        ax.text(0.5, 0.5, f"less than {LEAST:g} of the light", transform=ax.transAxes, ha="center", color="0.5")
        ax.set(xticks=[], yticks=[])
        ax.spines[:].set_visible(False)
        return
    lines = [f"{'':13}" + ("E_r      E_t" if transmits else "E_r")]
    for name, (angle, value, error) in curves.items():
        # Transmitted light is from 90° to 270°: what goes straight through is in the middle of it.
        turned = torch.where(angle < -math.pi / 2, angle + 2 * math.pi, angle)
        inside = turned.isfinite() if transmits else angle.abs() < math.pi / 2
        order = turned[inside].argsort()
        degrees = torch.rad2deg(turned[inside][order])
        y, dy = value[row, inside][order], error[row, inside][order]
        if name == SIMULATION:
            ax.fill_between(degrees, y - 2 * dy, y + 2 * dy, color="0.75", linewidth=0)
        ax.plot(degrees, y, label=name, **STYLE[name])
        lines.append(f"{name:12} " + "   ".join(f"{E:.4f}" for E in shares[name][: 2 if transmits else 1]))
    ax.text(0.02, 0.98, "\n".join(lines), transform=ax.transAxes, va="top", family="monospace", fontsize=7)
    ax.set_xlim((-90, 270) if transmits else (-90, 90))
    ax.set_xticks(range(-90, 271, 90) if transmits else range(-90, 91, 45))
    # Room on top for the numbers.
    ax.set_ylim(0, 1.75 * ax.get_ylim()[1])
    ax.grid(alpha=0.25)
