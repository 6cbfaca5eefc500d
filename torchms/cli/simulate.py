"""`torchms simulate`: bounce light on an explicit microsurface, and report what leaves after each bounce."""

import io
import os
from typing import Any

import numpy as np

from torchms.cli.arguments import check_angles, parse_alpha, parse_count
from torchms.cli.beside import beside, modelled
from torchms.cli.beside import table as both
from torchms.cli.description import exactly_described
from torchms.cli.options import SimulateOptions
from torchms.fresnel import Conductor
from torchms.lobes.tally import Tally
from torchms.maths.frame import direction
from torchms.microsurface.rays.grid_walk import GridTracer
from torchms.microsurface.rays.tracer import EmbreeTracer
from torchms.microsurface.simulation.distributed import process_group, rank_and_size
from torchms.microsurface.simulation.materials import DielectricFacets, DiffuseFacets, FacetMaterial, MirrorFacets
from torchms.microsurface.simulation.parts import facets_of, surfaces_of
from torchms.microsurface.simulation.simulate import simulate
from torchms.microsurface.surfaces.heightfield import Heightfield
from torchms.microsurface.surfaces.recipe import GaussianSurfaces
from torchms.storage.write import check_writable, write_json, write_whole

TRACERS = {"embree": EmbreeTracer, "grid": GridTracer}


def run_simulate(options: SimulateOptions) -> dict[str, Any]:
    """Run `torchms simulate`: print the energies, write the files asked for, return what the JSON holds.

    Under torchrun every process takes part and the first one prints and writes. Raises ValueError, OSError or
    ImportError with a message for the user.
    """
    for path in (options.json, options.lobes):
        if path is not None:
            check_writable(path, options.force)
    check_angles(options.theta, options.phi)
    n_rays = parse_count(options.rays, "--rays", 1)
    surface, facets = parts_of(options)
    model = modelled(options)
    with process_group():
        rank, size = rank_and_size()
        tally = simulate(
            surface,
            facets,
            direction(options.theta, options.phi),
            n_rays=n_rays,
            max_order=options.max_order,
            seed=options.seed,
            tracer=TRACERS[options.tracer](),
            interpolate_normals=options.interpolate_normals,
            lobes=options.lobes is not None,
            threads=options.threads,
            checkpoint=options.checkpoint,
            progress=options.progress and rank == 0,
        )
        result = result_of(tally, options, size)
        if rank == 0:
            if model is not None:
                result["model"] = beside(tally, model, options)
            write(tally, result, options)
            print(table(result) if model is None else f"{table(result)}\n{both(tally, result['model'])}")
    return result


def parts_of(options: SimulateOptions) -> tuple[Heightfield | GaussianSurfaces, FacetMaterial]:
    """The surface or surfaces that the options ask for, and what their facets do."""
    bsdf = exactly_described(options)
    if options.surface is not None:
        surface: Heightfield | GaussianSurfaces = Heightfield.from_file(
            options.surface, options.spacing, height_scale=options.height_scale, periodic=options.periodic
        )
    elif options.bsdf is None and options.distribution == "beckmann":
        alpha = parse_alpha(options.alpha, options.alpha_y)
        texels = {"size": options.size, "texels_per_correlation": options.texels_per_correlation}
        surface = GaussianSurfaces(*alpha, count=options.surfaces, **texels)
    else:
        surface = surfaces_of(bsdf.distribution, options.surfaces, options.size, options.texels_per_correlation)
    return surface, facets_of(bsdf) if options.bsdf is not None else facets_by_name(options)


def facets_by_name(options: SimulateOptions) -> FacetMaterial:
    """The facets of the short options, with the metals' numbers in the default dtype."""
    if options.material == "dielectric":
        return DielectricFacets(options.index)
    if options.material == "diffuse":
        return DiffuseFacets(options.facet_albedo)
    return MirrorFacets(None if options.metal is None else Conductor.metal(options.metal))


def result_of(tally: Tally, options: SimulateOptions, processes: int) -> dict[str, Any]:
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


def write(tally: Tally, result: dict[str, Any], options: SimulateOptions) -> None:
    """Write the files that the options ask for, atomically."""
    if options.json is not None:
        write_json(options.json, result, options.force)
    if options.lobes is not None and tally.lobes is not None:
        buffer = io.BytesIO()
        np.savez_compressed(buffer, mean=tally.lobes.mean.numpy(), stderr=tally.lobes.stderr.numpy())
        write_whole(options.lobes, buffer.getvalue(), options.force)


def _is_lit(value: Any) -> bool:
    """Whether any number of it, a list over orders and channels, is not 0."""
    return any(map(_is_lit, value)) if isinstance(value, list) else bool(value)


def table(result: dict[str, Any]) -> str:
    """The energies as text."""

    def cell(value: Any) -> str:
        if isinstance(value, list):
            return " ".join(cell(v) for v in value)
        return "n/a" if value is None else f"{value:.6f}"

    sides = [side for side in ("reflected", "transmitted") if side == "reflected" or _is_lit(result[side])]
    rows = [f"{'order':>5}" + "".join(f"  {side:>20}" for side in sides)]
    columns = [zip(result[side], result[f"{side}_stderr"], strict=True) for side in sides]
    for order, cells in enumerate(zip(*columns, strict=True), start=1):
        rows.append(f"{order:>5}" + "".join(f"  {cell(value)} ± {cell(error):>8}" for value, error in cells))
    alpha = " ".join(f"{a:.4f}" for a in result["slopes"]["alpha"])
    rows.append(f"left {cell(result['total'])}  absorbed {cell(result['absorbed'])}  lost {cell(result['lost'])}")
    rows.append(
        f"measured alpha {alpha}; leak rate {result['leak_rate']:.1e}; {result['rays_per_second'] / 1e6:.3f} M rays/s, "
        f"{result['segments_per_second'] / 1e6:.3f} M segments/s; errors over {result['stderr_over']}"
    )
    return "\n".join(rows)
