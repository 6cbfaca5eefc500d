"""The energy table: what leaves after each bounce, in every model, side by side."""

import math
from typing import Any

import torch

from torchms.approximations import KullaConty, Turquin
from torchms.bsdfs import BSDF, RoughConductor, RoughDielectric, RoughDiffuse
from torchms.cli.surface import EnergyOptions, SurfaceOptions
from torchms.distributions import GGX, GTR, Beckmann, MicrofacetDistribution
from torchms.estimators import HeightWalk, Scattering, SingleBounce, Unidirectional
from torchms.fresnel import Conductor, Dielectric, Fresnel, Ideal
from torchms.lobes.measure import incident_angles, measure
from torchms.lobes.tally import Tally
from torchms.paths.segments import Correlated, Invariance, Uncorrelated
from torchms.storage.write import check_writable, write_json

DISTRIBUTIONS = {"ggx": GGX, "beckmann": Beckmann}
MODELS = {
    "uncorrelated": lambda K: Unidirectional(Uncorrelated(), K),
    "correlated": lambda K: Unidirectional(Correlated(), K),
    "invariance": lambda K: Unidirectional(Invariance(), K),
    "height-walk": HeightWalk,
    "single-bounce": lambda K: SingleBounce(),
    "kulla-conty": lambda K: KullaConty(),
    "turquin": lambda K: Turquin(),
}

PARTIAL = ("invariance", "kulla-conty", "turquin")
"""Models that do not hold for every material: among others they are left out, alone they are refused."""


def parse_alpha(text: str) -> list[float]:
    """ "0.5" or "0.5,0.2" as [α] or [α_x, α_y]; ValueError otherwise."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise ValueError(f"--alpha must be one number or two with a comma, such as 0.5 or 0.5,0.2; got {text!r}.")
    return values


def parse_count(text: str, name: str, low: int) -> int:
    """A whole number that may be written as 1e6; ValueError if it is none or less than `low`."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value == int(value) and value >= low):
        raise ValueError(f"{name} must be a whole number of at least {low}, such as 1e6; got {text!r}.")
    return int(value)


def build_distribution(name: str, alpha: str, gamma: float | None) -> MicrofacetDistribution:
    """The distribution that --distribution, --alpha and --gamma describe; ValueError if they do not fit together."""
    alphas = parse_alpha(alpha)
    if name == "gtr":
        if len(alphas) > 1:
            raise ValueError(f"--distribution gtr is isotropic: --alpha must be one number; got {alpha!r}.")
        return GTR(alphas[0], 2.0 if gamma is None else gamma)
    if gamma is not None:
        raise ValueError(f"--gamma goes with --distribution gtr; got --distribution {name}.")
    return DISTRIBUTIONS[name](*alphas)


def build(options: SurfaceOptions, scattering: Scattering) -> BSDF:
    """The BSDF that the options describe: material, distribution and their numbers."""
    distribution = build_distribution(options.distribution, options.alpha, options.gamma)
    if options.material == "conductor":
        fresnel: Fresnel = Ideal() if options.metal is None else Conductor.metal(options.metal)
        return RoughConductor(distribution, fresnel, scattering)
    if options.metal is not None:
        raise ValueError(f"--metal goes with --material conductor; got --material {options.material}.")
    if options.material == "dielectric":
        return RoughDielectric(distribution, Dielectric(options.eta), scattering)
    return RoughDiffuse(distribution, options.albedo, scattering)


def run_energy(options: EnergyOptions) -> None:
    """Compute, print and, if asked for, save the energy table. Raises ValueError for options that do not fit."""
    n_paths = parse_count(options.samples, "--samples", 2)
    if options.json is not None:
        check_writable(options.json, options.force)
    for theta in options.theta:
        if not 0 <= theta < math.pi / 2:
            raise ValueError(f"--theta must lie in [0, pi/2) radians; got {theta:g}.")
    bsdfs: dict[str, BSDF] = {}
    left_out: dict[str, str] = {}
    for name in options.models:
        scattering = MODELS[name](options.max_order)
        try:
            bsdfs[name] = build(options, scattering)
        except ValueError as error:
            if name not in PARTIAL or len(options.models) == 1:
                raise
            left_out[name] = str(error)
    if not bsdfs:
        raise ValueError("; ".join(left_out.values()))

    tallies: dict[tuple[float, str], Tally] = {}
    for theta in options.theta:
        wi = incident_angles(theta, options.phi, dtype=torch.float32)
        for name, bsdf in bsdfs.items():
            tallies[theta, name] = measure(bsdf, wi, n_paths=n_paths, seed=options.seed)
    print(_table(options, tallies, list(bsdfs)))
    for name, reason in left_out.items():
        print(f"{name}: left out. {reason}")
    if options.json is not None:
        write_json(options.json, _document(options, tallies, left_out), options.force)


def _title(options: EnergyOptions) -> str:
    what = {
        "conductor": f"conductor {options.metal or 'with F = 1'}",
        "dielectric": f"dielectric with eta = {options.eta:g}, lit from outside",
        "diffuse": f"diffuse facets of albedo {options.albedo:g}",
    }[options.material]
    gamma = "" if options.gamma is None else f", gamma = {options.gamma:g}"
    facets = f"{options.distribution} alpha = {options.alpha}{gamma}"
    return f"{what}, {facets}, {options.samples} walks an entry, seed {options.seed}"


def _table(options: EnergyOptions, tallies: dict[tuple[float, str], Tally], models: list[str]) -> str:
    """The table as text: a row for every angle and order, a column for every model (two where light is transmitted)."""
    sides = ("R", "T") if options.material == "dielectric" else ("R",)
    header = ["theta", "k"] + [f"{name} {'E_' + side.lower()}" for name in models for side in sides]
    rows = [header]
    for theta in options.theta:
        for k in range(options.max_order):
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
        for label in ("rest", "total"):
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
        + "; rest: what had not left by then; total: what left."
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
