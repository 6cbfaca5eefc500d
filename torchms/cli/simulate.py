"""Options of `torchms simulate` and `torchms figures`. Nothing heavy is loaded until they run: `--help` is instant."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from torchms.lobes.tally import Tally
    from torchms.microsurface.simulation.materials import FacetMaterial
    from torchms.microsurface.surfaces.heightfield import Heightfield
    from torchms.microsurface.surfaces.recipe import GaussianSurfaces


@dataclass
class SimulateOptions:
    """Bounce light on the facets of an explicit microsurface and report what leaves after each bounce.

    Example: torchms simulate --material conductor --alpha 0.6 --theta 1.1 --rays 3e5 --json out.json
    """

    material: Literal["conductor", "dielectric", "diffuse"] = "conductor"
    """What the facets are: mirrors, smooth glass or ideally diffuse."""
    alpha: float = 0.5
    """Roughness along x of the Gaussian (Beckmann) surfaces; not used with --surface."""
    alpha_y: float | None = None
    """Roughness along y; as along x if not given."""
    theta: float = 0.0
    """Angle of incidence from the macro-normal, in radians, in [0, pi/2)."""
    phi: float = 0.0
    """Azimuth of incidence, in radians."""
    rays: float = 1e6
    """Light paths in all, shared among the surfaces."""
    max_order: int = 16
    """Bounces that are told apart; what is still inside after them is reported as lost (below 1e-4 for 16)."""
    seed: int = 0
    """Seed of surfaces and light paths."""
    surfaces: int = 8
    """Independent surfaces; the standard errors are their spread."""
    size: int = 1024
    """Texels along each edge of a surface."""
    texels_per_correlation: float = 16.0
    """Texels in one correlation length."""
    surface: Path | None = None
    """A measured surface instead: 16-bit PNG or TIFF height map, .npy, or a mesh (.ply, .obj, .stl, .off, .glb)."""
    spacing: float = 1.0
    """Distance between the texels of --surface."""
    height_scale: float = 1.0
    """Height of one step of the values of --surface, in the unit of --spacing."""
    periodic: bool = False
    """Whether --surface tiles without a seam; otherwise it is mirrored."""
    eta: float = 1.5
    """Dielectric: n_inside / n_outside."""
    metal: str | None = None
    """Conductor: a metal such as Cu or Au; without it every facet reflects everything (F = 1)."""
    albedo: float = 1.0
    """Diffuse: albedo of a facet."""
    interpolate_normals: bool = False
    """Scatter about normals interpolated between the vertices instead of the facets' own."""
    tracer: Literal["embree", "grid"] = "embree"
    """Embree on the triangle mesh, or a float64 walk over the heights (no Embree needed)."""
    threads: int | None = None
    """Threads of this process; all its cores if not given."""
    checkpoint: Path | None = None
    """Directory of finished shards; a run that was killed goes on from there."""
    json: Path | None = None
    """Where to write the result as JSON."""
    lobes: Path | None = None
    """Where to write the directional histograms as .npz (arrays mean and stderr)."""
    force: bool = False
    """Overwrite the output files if they exist."""
    progress: bool = True
    """Progress bar, if standard error is a terminal."""


@dataclass
class FiguresOptions:
    """Draw the lobes in the plane of incidence per bounce: explicit surface against the models.

    Example: torchms figures --material conductor --alpha 0.5 --out figures
    """

    material: Literal["conductor", "dielectric", "diffuse"] = "conductor"
    """What the facets are: mirrors (F = 1), smooth glass or ideally diffuse (albedo 1)."""
    alpha: float = 0.5
    """Roughness along x (Beckmann)."""
    alpha_y: float | None = None
    """Roughness along y; as along x if not given."""
    theta: tuple[float, ...] = (0.0, 0.5, 1.0, 1.5)
    """Angles of incidence, in radians; a column each."""
    phi: float = 0.0
    """Azimuth of incidence, in radians."""
    eta: float = 1.5
    """Dielectric: n_inside / n_outside."""
    rays: float = 2e6
    """Simulated light paths an angle."""
    walks: float = 5e5
    """Random walks a model and angle."""
    surfaces: int = 8
    """Independent surfaces; the grey band is twice their standard error."""
    size: int = 1024
    """Texels along each edge of a surface."""
    max_order: int = 10
    """Bounces that are told apart."""
    seed: int = 0
    """Seed of everything."""
    tracer: Literal["embree", "grid"] = "grid"
    """Embree, or the float64 walk over the heights, whose surfaces need no building."""
    out: Path = Path("figures")
    """Directory for the PNG, the SVG and the JSON."""
    force: bool = False
    """Overwrite them if they exist."""


def run_simulate(options: SimulateOptions) -> dict[str, Any]:
    """Run `torchms simulate`: print the energies, write the files asked for, return what the JSON holds.

    Under torchrun every process takes part and the first one prints and writes. Raises ValueError, OSError or
    ImportError with a message for the user.
    """
    from torchms.storage.write import check_writable

    for path in (options.json, options.lobes):
        if path is not None:
            check_writable(path, options.force)
    check_options(options)

    from torchms.microsurface.rays.grid_walk import GridTracer
    from torchms.microsurface.rays.tracer import EmbreeTracer
    from torchms.microsurface.simulation.distributed import process_group, rank_and_size
    from torchms.microsurface.simulation.simulate import simulate

    with process_group():
        rank, size = rank_and_size()
        tally = simulate(
            surface_of(options),
            material_of(options),
            direction(options.theta, options.phi),
            n_rays=int(options.rays),
            max_order=options.max_order,
            seed=options.seed,
            tracer=EmbreeTracer() if options.tracer == "embree" else GridTracer(),
            interpolate_normals=options.interpolate_normals,
            lobes=options.lobes is not None,
            threads=options.threads,
            checkpoint=options.checkpoint,
            progress=options.progress and rank == 0,
        )
        result = result_of(tally, options, size)
        if rank == 0:
            write(tally, result, options)
            print(table(result))
    return result


def check_options(options: SimulateOptions) -> None:
    """Raise ValueError for what the simulation itself cannot name by its option."""
    import math

    if not 0 <= options.theta < math.pi / 2:
        raise ValueError(
            f"--theta must lie in [0, pi/2) radians, above the horizon; got {options.theta}. For light from inside a "
            "dielectric pass --eta 1/eta."
        )
    if not math.isfinite(options.phi):
        raise ValueError(f"--phi must be a finite number of radians; got {options.phi}.")
    if not (math.isfinite(options.rays) and options.rays >= 1):
        raise ValueError(f"--rays must be a finite number of at least 1; got {options.rays}.")
    if options.metal is not None and options.material != "conductor":
        raise ValueError(f"--metal is for --material conductor; got --material {options.material}. Leave it out.")


def direction(theta: float, phi: float) -> tuple[float, float, float]:
    """Unit vector of these angles [rad]."""
    import math

    return (math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta))


def surface_of(options: SimulateOptions) -> "Heightfield | GaussianSurfaces":
    """The surface or surfaces that the options ask for."""
    from torchms.microsurface.surfaces.heightfield import Heightfield
    from torchms.microsurface.surfaces.recipe import GaussianSurfaces

    if options.surface is not None:
        return Heightfield.from_file(
            options.surface, options.spacing, height_scale=options.height_scale, periodic=options.periodic
        )
    return GaussianSurfaces(
        options.alpha, options.alpha_y, options.surfaces, options.size, options.texels_per_correlation
    )


def material_of(options: SimulateOptions) -> "FacetMaterial":
    """The material that the options ask for."""
    from torchms.microsurface.simulation.materials import Lambertian, Mirror, Refractive

    if options.material == "dielectric":
        return Refractive(options.eta)
    if options.material == "diffuse":
        return Lambertian(options.albedo)
    if options.metal is None:
        return Mirror()
    from torchms.fresnel import Conductor

    return Mirror(Conductor.metal(options.metal))


def result_of(tally: "Tally", options: SimulateOptions, processes: int) -> dict[str, Any]:
    """What the JSON holds; one channel is a plain list over orders, several are a list a channel for each order."""

    def plain(values: list) -> Any:
        return [v[0] if len(v) == 1 else v for v in values] if isinstance(values[0], list) else _single(values)

    energies = {k: plain(v) for k, v in tally.to_dict().items() if k not in ("n", "info")}
    info = dict(tally.info)
    given = {k: str(v) if isinstance(v, os.PathLike) else v for k, v in vars(options).items()}
    result = {k: _without_infinity(v) for k, v in energies.items()}
    for name in ("lost", "lost_stderr", "leaked", "absorbed"):
        result[name] = _without_infinity(_single(info.pop(name)))
    return result | {"n": tally.n, "options": given, "processes": processes} | info


def _single(values: list) -> Any:
    return values[0] if len(values) == 1 else values


def _without_infinity(value: Any) -> Any:
    """JSON has no infinity: the standard error of a single group is null."""
    if isinstance(value, list):
        return [_without_infinity(v) for v in value]
    return None if value == float("inf") else value


def write(tally: "Tally", result: dict[str, Any], options: SimulateOptions) -> None:
    """Write the files that the options ask for, atomically."""
    import io

    import numpy as np

    from torchms.storage.write import write_json, write_whole

    if options.json is not None:
        write_json(options.json, result, options.force)
    if options.lobes is not None and tally.lobes is not None:
        buffer = io.BytesIO()
        np.savez_compressed(buffer, mean=tally.lobes.mean.numpy(), stderr=tally.lobes.stderr.numpy())
        write_whole(options.lobes, buffer.getvalue(), options.force)


def table(result: dict[str, Any]) -> str:
    """The energies as text."""

    def cell(value: Any) -> str:
        if isinstance(value, list):
            return " ".join(cell(v) for v in value)
        return "n/a" if value is None else f"{value:.6f}"

    rows = [f"{'order':>5}  {'reflected':>20}  {'transmitted':>20}"]
    lists = (result[k] for k in ("reflected", "reflected_stderr", "transmitted", "transmitted_stderr"))
    for order, (r, dr, t, dt) in enumerate(zip(*lists, strict=True), start=1):
        rows.append(f"{order:>5}  {cell(r)} ± {cell(dr):>8}  {cell(t)} ± {cell(dt):>8}")
    alpha = " ".join(f"{a:.4f}" for a in result["slopes"]["alpha"])
    rows.append(f"left {cell(result['total'])}  absorbed {cell(result['absorbed'])}  lost {cell(result['lost'])}")
    rows.append(
        f"measured alpha {alpha}; leak rate {result['leak_rate']:.1e}; {result['rays_per_second'] / 1e6:.3f} M rays/s, "
        f"{result['segments_per_second'] / 1e6:.3f} M segments/s; errors over {result['stderr_over']}"
    )
    return "\n".join(rows)


def main() -> int:
    """`python -m torchms.cli.simulate`: the simulate command alone."""
    import tyro

    options = tyro.cli(SimulateOptions)
    try:
        run_simulate(options)
    except (ValueError, OSError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
