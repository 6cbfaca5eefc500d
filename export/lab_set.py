"""Write the files that the lobe lab reads, with their list.

    python -m export.lab_set --out export/lab/public/models

A file is kept while it is made of the same numbers, the weights of its networks and its tables, by the same version; the
list says of which. Other changes of the code are not seen: `--force` writes all anew.
"""

import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
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
    """Write only files whose names contain one of these; others that are there stay as they are."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Overwrite files."""


@dataclass(frozen=True)
class Item:
    """One file of the set: what stands in the list about it, and how to make its bytes."""

    name: str
    about: dict[str, Any]
    make: Callable[[], bytes] = field(repr=False)
    parts: Callable[[], Iterator[bytes]] = field(repr=False)

    def made_of(self) -> str:
        """A hash of all that its bytes depend on, but for the code of torchms."""
        from torchms.version import __version__

        found = hashlib.sha256(json.dumps([self.name, self.about, __version__]).encode())
        for part in self.parts():
            found.update(part)
        return found.hexdigest()[:16]


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
        about = {"what": "G1", "distribution": distribution}
        yield Item(f"masking-{distribution}", about, partial(_masking, distribution, roughness), _diagrams)
    for name in ("caps", "closed-forms"):
        yield Item(name, {"what": name}, partial(_diagram, name), _diagrams)


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

    def parts() -> Iterator[bytes]:
        yield json.dumps(inputs).encode()
        yield from numbers(material, distribution, model)

    return Item(name, about, make, parts)


def numbers(material: str, distribution: str, model: str) -> Iterator[bytes]:
    """Names and bytes of the parameters, tables and weights that a file holds."""
    from torchms.approximations.distilled import FACETS
    from torchms.parameters.exchange import parameters, weights

    bsdf = surface(material, distribution, model)
    # Distilled has the lobes of all surfaces, and uses those of this one.
    own = f".lobes.{type(bsdf.vertex.distribution).__name__} {FACETS[type(bsdf.vertex)]}."
    tensors = {name: found.value for name, found in parameters(bsdf).items()} | weights(bsdf)
    for name, tensor in tensors.items():
        if ".lobes." not in name or own in name:
            yield name.encode() + tensor.detach().numpy().tobytes()


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


def _diagrams() -> Iterator[bytes]:
    yield (Path(__file__).parent / "diagrams.py").read_bytes()


def metals() -> dict[str, Any]:
    """eta and k [1] of the measured metals in linear sRGB."""
    from torchms.fresnel.metals import table

    found = table()["metals"]
    return {key: {"name": each["names"][0], "eta": each["eta"], "k": each["k"]} for key, each in sorted(found.items())}


def write(options: Options) -> int:
    """Write what is missing or made of other numbers, and the list; the number of files in it."""
    from torchms.storage.write import write_whole

    options.out.mkdir(parents=True, exist_ok=True)
    known = listed(options.out)
    found: dict[str, dict[str, Any]] = {}
    for item in items():
        path, made_of = options.out / f"{item.name}.onnx", item.made_of()
        wanted = not options.only or any(part in item.name for part in options.only)
        written = known.get(path.name, {}).get("made_of")
        if wanted and (options.force or not path.exists() or written != made_of):
            write_whole(path, item.make(), True)
            print(f"{path}: {path.stat().st_size} bytes", flush=True)
            written = made_of
        if path.exists():
            found[path.name] = {"file": path.name, "bytes": path.stat().st_size, "made_of": written, **item.about}
            # After every file: what was made before an interrupt is not made again.
            write_list(options.out, known | found)
    for name in known.keys() - found.keys():
        (options.out / name).unlink(missing_ok=True)
    write_list(options.out, found)
    return len(found)


def listed(folder: Path) -> dict[str, dict[str, Any]]:
    """Entries of the list in the folder by the names of their files; none if there is no list that can be read."""
    from torchms.storage.write import read_json

    try:
        return {entry["file"]: entry for entry in read_json(folder / "models.json")["models"]}
    except (OSError, ValueError, KeyError):
        return {}


def write_list(folder: Path, entries: dict[str, dict[str, Any]]) -> None:
    """What the page reads first."""
    from torchms.storage.write import write_whole
    from torchms.version import __version__

    command = "python -m export.lab_set"
    content = {"torchms": __version__, "command": command, "metals": metals(), "models": [*entries.values()]}
    write_whole(folder / "models.json", json.dumps(content, indent=1, ensure_ascii=False).encode(), True)


def main() -> int:
    """Run; the exit code."""
    options = tyro.cli(Options, description=__doc__)
    from torchms.cli.exit_code import exit_code

    def run() -> None:
        print(f"{write(options)} files in {options.out}.")

    return exit_code("export", run, "files that were written are whole, and are kept next time.")


if __name__ == "__main__":
    sys.exit(main())
