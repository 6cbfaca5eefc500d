"""Write the files that the lobe lab reads, with their list.

    python -m export.lab_set --out export/lab/public/models

A file that is there is kept; `--force` writes all anew.
"""

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

EXACT_ORDERS = 6
"""Bounces of the exact models, which the page accumulates."""

GRAY = {"conductor": ("eta", "k"), "dielectric": ("eta",), "diffuse": ("albedo",)}
"""Inputs of a material beside its roughness."""

ROUGHNESS = {"ggx": ("alpha", "alpha_y"), "beckmann": ("alpha", "alpha_y"), "gtr": ("alpha", "gamma")}


@dataclass(frozen=True)
class Options:
    """Write the ONNX files of the lobe lab and models.json, their list."""

    out: Path = Path("export/lab/public/models")
    """Folder for the files; it is made if it does not exist."""
    only: tuple[str, ...] = ()
    """Write only files whose names contain one of these; those that are there are listed."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite files."""


@dataclass(frozen=True)
class Item:
    """One file of the set: what stands in the list about it, and how to make its bytes."""

    name: str
    about: dict[str, Any]
    make: Callable[[], bytes] = field(repr=False)


def items() -> Iterator[Item]:
    """The set: evaluators of orders, directions with their density, and diagrams of the distributions."""
    for material in GRAY:
        for distribution in ROUGHNESS:
            for model in models_of(material, distribution):
                yield evaluator(material, distribution, model, "orders")
            if material != "diffuse":
                yield evaluator(material, distribution, "single-bounce", "sample")
    yield evaluator("diffuse", "ggx", "single-bounce", "sample")
    for distribution, roughness in ROUGHNESS.items():
        name = f"masking-{distribution}"
        yield Item(
            name, {"what": "G1", "distribution": distribution}, lambda d=distribution, r=roughness: _masking(d, r)
        )
    for name in ("caps", "closed-forms"):
        yield Item(name, {"what": name}, lambda name=name: _diagram(name))


def models_of(material: str, distribution: str) -> tuple[str, ...]:
    """Models that hold for this surface; the exact one first."""
    exact = "height-walk" if material == "dielectric" else "invariance"
    if distribution == "gtr":
        return (exact, "single-bounce")
    closed = () if material == "diffuse" else ("kulla-conty", "turquin")
    return (exact, "distilled", *closed, "single-bounce")


def surface(material: str, distribution: str, model: str) -> Any:
    """The BSDF of a file, with parameters that its inputs will replace."""
    from torchms import Distilled
    from torchms.bsdfs.named import DISTRIBUTIONS, MATERIALS, SCATTERINGS
    from torchms.fresnel import Conductor, Dielectric

    scattering = Distilled() if model == "distilled" else SCATTERINGS[model](EXACT_ORDERS)
    second = {"gtr": (2.0,), "ggx": (0.5,), "beckmann": (0.5,)}[distribution]
    shape = DISTRIBUTIONS[distribution](0.5, *(() if is_isotropic(material, model) else second))
    facet = {"conductor": Conductor.metal("Au"), "dielectric": Dielectric(1.5), "diffuse": [0.8, 0.8, 0.8]}[material]
    # Power that passes, without the squares of the indices: then the energies of a lobe add up to one.
    mode = {"mode": "importance"} if material == "dielectric" else {}
    return MATERIALS[material](shape, facet, scattering, **mode)  # type: ignore[call-arg]


def is_isotropic(material: str, model: str) -> bool:
    """Whether the model holds for α_x = α_y only."""
    return material == "dielectric" and model in ("kulla-conty", "turquin")


def is_smooth(material: str, model: str) -> bool:
    """Whether a lobe needs no random walks; facets that are rough themselves do in the first bounce, too."""
    exact = model in ("invariance", "height-walk")
    return not exact and not (material == "diffuse" and model == "single-bounce")


def evaluator(material: str, distribution: str, model: str, what: str) -> Item:
    """`what` of a surface as a file."""
    name = f"{material}-{distribution}-{what if what == 'sample' else model}"
    roughness = ("alpha",) if is_isotropic(material, model) else ROUGHNESS[distribution]
    inputs = roughness + (GRAY[material] if what == "orders" or material == "dielectric" else ())
    if what == "sample" and material == "diffuse":
        inputs = ()
    exact = model in ("invariance", "height-walk")
    random = what == "orders" and not is_smooth(material, model)
    about: dict[str, Any] = {"what": what, "material": material, "distribution": distribution, "model": model}
    about |= {"exact": exact, "random": random}
    about["isotropic"] = "alpha_y" not in inputs and bool(inputs)
    if what == "orders":
        about["orders"] = orders_of(material, model)

    def make() -> bytes:
        from torchms.onnx.exporter import exported

        paths = None if random or what == "sample" else 1
        return exported(surface(material, distribution, model), what=what, parameters=inputs, n_paths=paths)

    return Item(name, about, make)


def orders_of(material: str, model: str) -> list[str]:
    """Bounces that each order of the output counts; "n+" is n and more, together."""
    if model == "distilled":
        return ["1", "2+"] if material == "dielectric" else ["1", "2", "3", "4+"]
    if model in ("kulla-conty", "turquin"):
        return ["1", "2+"]
    return ["1"] if model == "single-bounce" else [str(k + 1) for k in range(EXACT_ORDERS)]


def _masking(distribution: str, roughness: tuple[str, ...]) -> bytes:
    from export.diagrams import diagram_bytes, masking
    from torchms.bsdfs.named import DISTRIBUTIONS

    return diagram_bytes(masking(DISTRIBUTIONS[distribution](0.5, 2.0 if distribution == "gtr" else 0.5), roughness))


def _diagram(name: str) -> bytes:
    from export.diagrams import caps, closed_forms, diagram_bytes

    return diagram_bytes(caps() if name == "caps" else closed_forms())


def metals() -> dict[str, Any]:
    """eta and k [1] of the measured metals in linear sRGB."""
    from torchms.fresnel.metals import table

    found = table()["metals"]
    return {key: {"name": each["names"][0], "eta": each["eta"], "k": each["k"]} for key, each in sorted(found.items())}


def write(options: Options) -> int:
    """Write what is missing, then the list; the number of files in it."""
    from torchms.storage.write import write_whole
    from torchms.version import __version__

    options.out.mkdir(parents=True, exist_ok=True)
    listed = []
    for item in items():
        path = options.out / f"{item.name}.onnx"
        wanted = not options.only or any(part in item.name for part in options.only)
        if wanted and (options.force or not path.exists()):
            write_whole(path, item.make(), True)
            print(f"{path}: {path.stat().st_size} bytes", flush=True)
        if path.exists():
            listed.append({"file": path.name, "bytes": path.stat().st_size, **item.about})
    content = {"torchms": __version__, "command": "python -m export.lab_set", "metals": metals(), "models": listed}
    write_whole(options.out / "models.json", json.dumps(content, indent=1, ensure_ascii=False).encode(), True)
    return len(listed)


def main() -> int:
    """Run; the exit code."""
    options = tyro.cli(Options, description=__doc__)
    from torchms.cli.exit_code import exit_code

    def run() -> None:
        print(f"{write(options)} files in {options.out}.")

    return exit_code("export", run, "the files that are there are whole, and are kept next time.")


if __name__ == "__main__":
    sys.exit(main())
