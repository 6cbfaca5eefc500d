"""`torchms fit-measured`: a metal-roughness material for a measured surface, with all bounces and with one."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from torchms.cli.plain_options import FitMeasuredOptions
from torchms.cli.progress import progress_bar
from torchms.extras import missing
from torchms.measured import MeasuredBRDF
from torchms.measured.fit import HIGH, INCIDENCE, LOW, NAMES, RELIABLE, Comparison, fitted, samples, steps
from torchms.storage.write import check_writable, write_json, write_whole

BOUNCES = ("all", "one")


def run_fit_measured(options: FitMeasuredOptions) -> list[Comparison]:
    """Fit, print, and write what is asked for. Raises ValueError or OSError before the work for what will not do."""
    hold = {name: value for name in ("metallic", "ior") if (value := getattr(options, name)) is not None}
    for name, value in hold.items():
        low, high = (bound[NAMES.index(name)] for bound in (LOW, HIGH))
        if not low <= value <= high:
            raise ValueError(f"--{name} must lie in [{low:g}, {high:g}]; got {value:g}.")
    for path in (options.out, options.json):
        if path is not None:
            check_writable(path, options.force)
    if options.out is not None:
        _matplotlib(options.out)
    brdf, at = MeasuredBRDF.load(options.file), samples()
    found = []
    with progress_bar("fit", len(BOUNCES) * steps()) as advance:
        for bounces in BOUNCES:
            found.append(fitted(brdf, bounces, diffuse=options.diffuse, hold=hold, at=at, advance=advance))
    print(_report(options, brdf, found))
    if options.json is not None:
        write_json(options.json, _document(options, brdf, found), options.force)
    if options.out is not None:
        from torchms.measured.picture import picture

        write_whole(options.out, picture(brdf, found), options.force)
    return found


def _matplotlib(path: Path) -> None:
    if path.suffix.lower() != ".png":
        raise ValueError(f"--out must end in .png; got {path.name}.")
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise missing("the picture", "matplotlib") from error


def _report(options: FitMeasuredOptions, brdf: MeasuredBRDF, found: list[Comparison]) -> str:
    """The table as text: parameters with their standard errors, then residuals."""
    title = f"{options.file.name}: {brdf.description}; MetallicRoughness(diffuse={options.diffuse!r})"
    rows = [["", *(f"bounces = {c.bounces}" for c in found)]]
    for k, name in enumerate(NAMES):
        rows.append([name, *(_cell(c, k, getattr(options, name, None) is not None) for c in found)])
    parts: list[tuple[str, Any]] = [("all", None), ("over the hemisphere", ~found[0].at.near)]
    parts.append(("about the mirror direction", found[0].at.near))
    parts += [(f"view at {a:g} deg", found[0].at.angle == a) for a in INCIDENCE]
    rows += [[f"residual, {label}", *(f"{100 * c.rms(where):.2f} %" for c in found)] for label, where in parts]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    ]
    note = (
        f"residual: root mean square of (model - measured) / (measured + its mean), view and light within {RELIABLE:g} deg; "
        "errors: Gauss-Newton, as if residuals were noise."
    )
    return "\n".join([title, *lines, note])


def _cell(c: Comparison, k: int, held: bool) -> str:
    error = float(c.errors[k])
    told = "held" if held else "at its bound" if math.isnan(error) else f"± {error:.4f}"
    return f"{float(c.values[k]):.4f} {told}"


def _document(options: FitMeasuredOptions, brdf: MeasuredBRDF, found: list[Comparison]) -> dict[str, Any]:
    configuration = {key: str(v) if isinstance(v, Path) else v for key, v in asdict(options).items()}
    configuration = {key: v for key, v in configuration.items() if key not in ("out", "json", "force")}
    fits = {}
    for c in found:
        errors = [None if math.isnan(e) else e for e in c.errors.tolist()]
        fits[c.bounces] = {
            "values": dict(zip(NAMES, c.values.tolist(), strict=True)),
            "errors": dict(zip(NAMES, errors, strict=True)),
            "residual": c.rms(),
            "residual_hemisphere": c.rms(~c.at.near),
            "residual_mirror": c.rms(c.at.near),
            "residual_by_angle": {f"{a:g}": c.rms(c.at.angle == a) for a in INCIDENCE},
        }
    return {
        "configuration": configuration,
        "description": brdf.description,
        "samples": len(found[0].at.view),
        "fits": fits,
    }
