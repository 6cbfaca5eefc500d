"""What is wrong with a command line, said before torch is loaded: options that do not apply, files, missing extras.

Each function raises ValueError, OSError or ImportError. What only the surface itself can tell comes later.
"""

from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchms.cli.options import EnergyOptions, ExportOptions, FiguresOptions, RenderOptions, SimulateOptions
from torchms.cli.plain_options import DistilOptions, FitMeasuredOptions, LutOptions
from torchms.cli.surface import SurfaceOptions
from torchms.extras import require
from torchms.storage.write import check_writable

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

PICTURES = (".exr", ".png")
ONE_BOUNCE = ("single-bounce", "kulla-conty", "turquin", "distilled")
"""Models that have no number of bounces to choose."""


def is_given(options: "DataclassInstance", name: str) -> bool:
    """Whether an option differs from what its command takes if nobody names it."""
    default = next(field.default for field in fields(options) if field.name == name)
    return getattr(options, name) != default


def word(name: str) -> str:
    """An option as it is written."""
    return f"--{name.replace('_', '-')}"


def refuse(options: "DataclassInstance", names: Iterable[str], why: str) -> None:
    """Raise ValueError if one of these options is given."""
    if given := [word(name) for name in names if is_given(options, name)]:
        raise ValueError(f"{', '.join(given)} would change nothing: {why}.")


def check(options: "DataclassInstance") -> None:
    """Everything that can be checked here for the command of these options."""
    if isinstance(options, SurfaceOptions):
        check_surface(options)
    for kind, function in CHECKS.items():
        if isinstance(options, kind):
            function(options)


def check_surface(o: SurfaceOptions) -> None:
    """The options that say what the surface is; ValueError if some do not go together."""
    short = [field.name for field in fields(SurfaceOptions) if field.name != "bsdf"]
    if o.bsdf is not None:
        if named := [word(name) for name in short if is_given(o, name)]:
            raise ValueError(f"--bsdf says all of the surface: leave out {', '.join(named)}, or --bsdf.")
        return
    for name, material in {"metal": "conductor", "eta": "dielectric", "albedo": "diffuse"}.items():
        if is_given(o, name) and o.material != material:
            raise ValueError(f"{word(name)} goes with --material {material}; got --material {o.material}.")
    if o.gamma is not None and o.distribution != "gtr":
        raise ValueError(f"--gamma goes with --distribution gtr; got --distribution {o.distribution}.")


def _energy(o: EnergyOptions) -> None:
    _writable(o.force, o.json)
    if o.bsdf is not None and not is_given(o, "models"):
        refuse(o, ["max_order"], "the model of --bsdf has its own number of bounces")


def _explicit(o: SimulateOptions | FiguresOptions) -> None:
    require(f"torchms {'simulate' if isinstance(o, SimulateOptions) else 'figures'}", "numba", "trimesh")
    if o.tracer == "embree":
        require("--tracer embree", "embreex")


def _simulate(o: SimulateOptions) -> None:
    _writable(o.force, o.json, o.lobes)
    _explicit(o)
    if o.surface is None:
        refuse(o, ["spacing", "height_scale", "periodic"], "they describe the file of --surface, which is not given")
    else:
        why = "the file of --surface has its own facets and texels"
        refuse(o, ["distribution", "alpha", "alpha_y", "size", "surfaces", "texels_per_correlation"], why)
    if o.model is None:
        refuse(o, ["walks"], "they are those of --model, which is not given")


def _figures(o: FiguresOptions) -> None:
    _explicit(o)
    require("torchms figures", "matplotlib")


def _render(o: RenderOptions) -> None:
    files = [o.out, *([] if o.stderr is None else [o.stderr])]
    for option, file in zip(("--out", "--stderr"), files, strict=False):
        _suffix(option, file, PICTURES, "PNG is tone-mapped, EXR is linear")
        require(f"{file}", "OpenEXR" if file.lower().endswith(".exr") else "Pillow")
    _writable(o.force, *files)
    if not any(file.lower().endswith(".png") for file in files):
        refuse(o, ["tone", "exposure"], "an EXR file is linear")
    if o.light != "directional":
        refuse(o, ["towards_light"], f"it is the direction of --light directional; got --light {o.light}")
    else:
        refuse(o, ["sampling"], "light of one direction is not sampled. Choose another --light")
    if o.scene in ("slab", "sphere", "plane"):
        refuse(o, ["crease"], f"it smooths the mesh of a file; got {o.scene}")
    if o.bsdf is None and o.material != "dielectric":
        refuse(o, ["inner"], "light does not enter this material. It goes with --material dielectric")
    _orders(o)


def _export(o: ExportOptions) -> None:
    _suffix("the path", o.path, (".onnx",), "that is what is written")
    if not o.check:
        refuse(o, ["json", "rows"], "they belong to the comparison, --check")
    _writable(o.force, o.path, o.json)
    require("torchms export", "onnx", "onnxscript")
    if o.check:
        require("--check", "onnxruntime")
    _orders(o)


def _orders(o: RenderOptions | ExportOptions) -> None:
    if o.scattering in ONE_BOUNCE:
        refuse(o, ["max_order"], f"--scattering {o.scattering} has a number of bounces of its own")
    elif o.bsdf is not None and o.scattering is None:
        refuse(
            o,
            ["max_order"],
            "the model of --bsdf has its own number of bounces. Name a --scattering, or write it there",
        )


def _lut(o: LutOptions) -> None:
    _writable(o.force, o.out)


def _fit_measured(o: FitMeasuredOptions) -> None:
    if o.out is not None:
        _suffix("--out", o.out, (".png",), "it is a picture")
        require("the picture", "matplotlib")
    _writable(o.force, o.out, o.json)
    if not o.file.is_file():
        raise FileNotFoundError(f"there is no file {o.file}.")


def _distil(o: DistilOptions) -> None:
    _suffix("--out", o.out, (".npz",), "that is what is written")
    _writable(o.force, o.out, o.json)
    require("torchms distil", "numba", "trimesh")
    if not o.surface.is_file():
        raise FileNotFoundError(f"there is no file {o.surface}.")


def _writable(force: bool, *paths: str | Path | None) -> None:
    for path in paths:
        if path is not None:
            check_writable(path, force)


def _suffix(option: str, path: str | Path, suffixes: tuple[str, ...], why: str) -> None:
    if Path(path).suffix.lower() not in suffixes:
        raise ValueError(f"{option} must end in {' or '.join(suffixes)}; got {Path(path).name}: {why}.")


CHECKS: dict[type, Callable[[Any], None]] = {
    EnergyOptions: _energy,
    SimulateOptions: _simulate,
    FiguresOptions: _figures,
    RenderOptions: _render,
    ExportOptions: _export,
    LutOptions: _lut,
    FitMeasuredOptions: _fit_measured,
    DistilOptions: _distil,
}
