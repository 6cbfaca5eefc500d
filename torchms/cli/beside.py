"""The model of a surface beside the surface: what `torchms simulate --model` adds."""

from typing import Any

from torchms.bsdfs import BSDF
from torchms.bsdfs.named import SCATTERINGS
from torchms.cli.arguments import parse_count
from torchms.cli.description import exactly_described
from torchms.cli.options import SimulateOptions
from torchms.lobes.measure import measure
from torchms.lobes.tally import Tally
from torchms.maths.frame import direction
from torchms.microsurface.simulation.against import against

COLUMNS = ("order", "surface", "model", "z")
SHOWN = 5e-7
"""Least energy that has a digit in the table."""


def modelled(options: SimulateOptions) -> BSDF | None:
    """The surface with the model of --model in its scattering slot; None without the option. ValueError if it does not hold."""
    if options.model is None:
        return None
    parse_count(options.walks, "--walks", 2)
    if options.model != "own":
        return exactly_described(options, SCATTERINGS[options.model](options.max_order)).double()
    if options.bsdf is None:
        raise ValueError(
            "--model own is the scattering of --bsdf, which is not given. Name a model, such as height-walk."
        )
    return exactly_described(options)


def beside(surface: Tally, bsdf: BSDF, options: SimulateOptions) -> dict[str, Any]:
    """Energies of the model's own walk and their z against the surface's, as lists over orders and channels."""
    wi = direction(options.theta, options.phi)
    walks = parse_count(options.walks, "--walks", 2)
    tally = measure(bsdf, wi, n_paths=walks, seed=options.seed, progress=options.progress, threads=options.threads)
    z = {name: _known(values.tolist()) for name, values in against(surface, tally)._asdict().items()}
    return {"name": options.model, "z": z} | tally.to_dict()


def table(surface: Tally, model: dict[str, Any]) -> str:
    """Surface and model as text: a row for each order that light leaves after, on either side, and one for all together."""
    rows: list[tuple[str, ...]] = [COLUMNS]
    for side in ("reflected", "transmitted"):
        simulated = zip(getattr(surface, side).tolist(), getattr(surface, f"{side}_stderr").tolist(), strict=True)
        walked = zip(model[side], model[f"{side}_stderr"], model["z"][side], strict=False)
        for order, ((a, da), (b, db, z)) in enumerate(zip(simulated, walked, strict=False), start=1):
            if max(*a, *b) >= SHOWN:
                rows.append((f"{side[0].upper()} {order}", _cell(a, da), _cell(b, db), _text(z)))
    total = _cell(surface.total.tolist(), surface.total_stderr.tolist())
    rows.append(("all", total, _cell(model["total"], model["total_stderr"]), _text(model["z"]["total"])))
    widths = [max(len(row[i]) for row in rows) for i in range(len(COLUMNS))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    note = "R, T: what leaves on the side of the light, and on the other; z: the difference in its standard errors."
    return "\n".join([f"model {model['name']}, {model['n']} walks", *lines, note])


def _cell(values: list[float], errors: list[float]) -> str:
    return " ".join(f"{v:.6f}" for v in values) + f" ± {max(errors):.6f}"


def _text(z: list[float | None]) -> str:
    return " ".join("n/a" if value is None else f"{value:+.1f}" for value in z)


def _known(values: Any) -> Any:
    """JSON has no NaN: what is not known is null."""
    if isinstance(values, list):
        return [_known(value) for value in values]
    return None if values != values else values
