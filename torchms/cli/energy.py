"""`torchms energy`: what leaves after each bounce, in every model, side by side."""

from typing import Any

import torch

from torchms.bsdfs import BSDF
from torchms.bsdfs.named import SCATTERINGS
from torchms.cli.arguments import check_angles, parse_count
from torchms.cli.beforehand import is_given
from torchms.cli.description import described
from torchms.cli.options import EnergyOptions
from torchms.lobes.measure import measure
from torchms.lobes.tally import Tally
from torchms.maths.frame import direction
from torchms.storage.write import check_writable, write_json

PARTIAL = ("invariance", "kulla-conty", "turquin", "distilled")
"""Models that do not hold for every material: among others they are left out, alone they are refused."""


def run_energy(options: EnergyOptions) -> None:
    """Compute, print and, if asked for, save the energy table. Raises ValueError for options that do not fit."""
    n_paths = parse_count(options.samples, "--samples", 2)
    if options.json is not None:
        check_writable(options.json, options.force)
    for theta in options.theta:
        check_angles(theta, options.phi)
    bsdfs, left_out = _modelled(options)
    tallies: dict[tuple[float, str], Tally] = {}
    for theta in options.theta:
        for name, bsdf in bsdfs.items():
            wi = direction(theta, options.phi, dtype=torch.float32)
            tallies[theta, name] = measure(bsdf, wi, n_paths=n_paths, seed=options.seed)
    transmits = any(bsdf.vertex.transmits for bsdf in bsdfs.values())
    print(_table(options, tallies, list(bsdfs), transmits))
    for name, reason in left_out.items():
        print(f"{name}: left out. {reason}")
    if options.json is not None:
        write_json(options.json, _document(options, tallies, left_out), options.force)


def _modelled(options: EnergyOptions) -> tuple[dict[str, BSDF], dict[str, str]]:
    """The surface in each model, and why others are left out."""
    if options.bsdf is not None and not is_given(options, "models"):
        bsdf = described(options)
        return {type(bsdf.scattering).__name__: bsdf}, {}
    bsdfs: dict[str, BSDF] = {}
    left_out: dict[str, str] = {}
    for name in options.models:
        scattering = SCATTERINGS[name](options.max_order)
        try:
            bsdfs[name] = described(options, scattering)
        except ValueError as error:
            if name not in PARTIAL or len(options.models) == 1:
                raise
            left_out[name] = str(error)
    if not bsdfs:
        raise ValueError("; ".join(left_out.values()))
    return bsdfs, left_out


def _title(options: EnergyOptions) -> str:
    walks = f"{options.samples} walks an entry, seed {options.seed}"
    if options.bsdf is not None:
        return f"{options.bsdf}, {walks}"
    what = {
        "conductor": f"conductor {options.metal or 'with F = 1'}",
        "dielectric": f"dielectric with eta = {options.index:g}, lit from outside",
        "diffuse": f"diffuse facets of albedo {options.facet_albedo:g}",
    }[options.material]
    alpha = options.alpha if options.alpha_y is None else f"{options.alpha},{options.alpha_y:g}"
    gamma = "" if options.gamma is None else f", gamma = {options.gamma:g}"
    return f"{what}, {options.distribution} alpha = {alpha}{gamma}, {walks}"


def _table(options: EnergyOptions, tallies: dict[tuple[float, str], Tally], models: list[str], transmits: bool) -> str:
    """The table as text: a row for every angle and order, a column for every model (two where light is transmitted)."""
    sides = ("R", "T") if transmits else ("R",)
    header = ["theta", "k"] + [f"{name} {'E_' + side.lower()}" for name in models for side in sides]
    rows = [header]
    longest = max(len(tally.reflected) for tally in tallies.values())
    for theta in options.theta:
        for k in range(min(options.max_order, longest)):
            cells = [f"{theta:.4g}" if k == 0 else "", str(k + 1)]
            for name in models:
                tally = tallies[theta, name]
                for side in sides:
                    values, errors = (
                        (tally.reflected, tally.reflected_stderr)
                        if side == "R"
                        else (tally.transmitted, tally.transmitted_stderr)
                    )
                    cells.append(_cell(values[k], errors[k]) if k < len(values) else "-")
            rows.append(cells)
        for label in ("remaining", "total"):
            cells = ["", label]
            for name in models:
                tally = tallies[theta, name]
                cells.append(_cell(getattr(tally, label), getattr(tally, f"{label}_stderr")))
                cells += [""] * (len(sides) - 1)
            rows.append(cells)
    widths = [max(len(row[i]) for row in rows) for i in range(len(header))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    lines.insert(1, "  ".join("-" * width for width in widths))
    note = (
        "E_k: share of the incident energy that leaves after exactly k bounces, ± standard error"
        + (" (channels R G B, the largest error)" if _channels(tallies) == 3 else "")
        + "; remaining: what had not left by then; total: what left."
    )
    return "\n".join([_title(options), *lines, note])


def _channels(tallies: dict[tuple[float, str], Tally]) -> int:
    return next(iter(tallies.values())).total.shape[-1]


def _cell(values: torch.Tensor, errors: torch.Tensor) -> str:
    return " ".join(f"{v:.5f}" for v in values.tolist()) + f" ± {errors.max().item():.5f}"


def _document(
    options: EnergyOptions, tallies: dict[tuple[float, str], Tally], left_out: dict[str, str]
) -> dict[str, Any]:
    configuration = {key: value for key, value in vars(options).items() if key not in ("json", "force")}
    rows = [{"theta_i": theta, "model": name} | tally.to_dict() for (theta, name), tally in tallies.items()]
    return {"configuration": configuration, "rows": rows, "left_out": left_out}
