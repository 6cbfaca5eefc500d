"""The shape of the package: imports point down, random numbers come from one place, sources are named, nothing is
unpickled, and every public class stands in the tables that the laws run over."""

import ast
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import cases
import pytest
from torch import nn

import torchms
from torchms import fresnel

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "torchms"
SOURCES = sorted(PACKAGE.rglob("*.py"))

LAYERS = (
    # What everything stands on.
    ("version", "typing", "lazy", "storage", "cli.progress", "cli.exit_code"),
    ("maths", "machine"),
    ("parameters.declared", "parameters.exchange", "parameters.maps", "slopes"),
    # A facet, the heights between facets, and both together.
    ("distributions", "fresnel"),
    ("sampling.warps", "sampling.uniforms", "sampling.point_sets", "sampling.stream"),
    ("paths",),
    ("sampling.proposals",),
    # The sum over bounces, estimated or approximated; a surface.
    ("estimators",),
    ("approximations",),
    ("evaluation",),
    ("bsdfs",),
    # What is done with a surface.
    ("parameters.constrain", "citations"),
    ("lobes", "testing", "render", "shading", "measured", "dropins", "approximations.distil"),
    ("microsurface", "onnx", "mitsuba"),
    # The command line.
    ("cli", "__main__"),
)
"""A module imports only from its own layer and from those before it. A longer name overrules its package's."""

LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}

CITATION = re.compile(r"\[([A-Z][A-Za-z]+\d{4}[a-z]?)\b")


def module_name(path: Path) -> str:
    """Of a file of the package, without the package's own name; "" for its `__init__`."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def level(name: str) -> int:
    """The layer of a module or of its package."""
    while name:
        if name in LEVEL:
            return LEVEL[name]
        name = name.rpartition(".")[0]
    raise KeyError(name)


def imports(path: Path) -> Iterator[str]:
    """Modules of the package that a file imports anywhere, also inside functions; not those for annotations only."""
    tree = ast.parse(path.read_text())
    annotations = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in annotations:
            continue
        if isinstance(node, ast.Import):
            yield from (a.name.removeprefix("torchms.") for a in node.names if a.name.startswith("torchms."))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "torchms":
            package = (node.module or "").removeprefix("torchms").lstrip(".")
            for alias in node.names:
                inner = f"{package}.{alias.name}".lstrip(".")
                is_module = (PACKAGE / inner.replace(".", "/")).with_suffix(".py").exists()
                is_package = (PACKAGE / inner.replace(".", "/")).is_dir()
                if package or is_module or is_package:
                    yield inner if is_module or is_package else package


@pytest.mark.parametrize("path", SOURCES, ids=[str(p.relative_to(PACKAGE)) for p in SOURCES])
def test_imports_point_down(path):
    name = module_name(path)
    if not name:
        return  # torchms/__init__.py names everything, and loads it when it is asked for
    up = [other for other in imports(path) if level(other) > level(name)]
    assert not up, f"{name} is below {', '.join(up)}"


def test_imports_inside_a_layer_have_no_cycle():
    """Packages of one layer do not import each other both ways."""
    arrows = {
        (module_name(path).split(".")[0], other.split(".")[0])
        for path in SOURCES
        for other in imports(path)
        if module_name(path) and level(module_name(path)) == level(other)
    }
    assert not [(a, b) for a, b in arrows if a < b and (b, a) in arrows]


LONGEST_FILE, LONGEST_FUNCTION = 250, 50
"""Lines; of a function those of its body, without its docstring."""

LONG = {
    "maths/special.py": "tables of coefficients, which a program writes",
    "microsurface/rays/embree_kernels.py:resolve": "a kernel of Numba: a call in its loop over rays would copy the state",
    "microsurface/rays/grid_walk_kernel.py:walk": "a kernel of Numba: the walk's state is twenty numbers in registers",
}
"""What is longer, and why."""


@pytest.mark.parametrize("path", SOURCES, ids=[str(p.relative_to(PACKAGE)) for p in SOURCES])
def test_one_idea_a_file(path):
    """A file is short enough to be read at once, and a function fits on a screen."""
    name = path.relative_to(PACKAGE).as_posix()
    source = path.read_text()
    found = {name: len(source.splitlines()) - LONGEST_FILE}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            lines = (node.end_lineno or 0) - body[0].lineno + 1 if body else 0
            found[f"{name}:{node.name}"] = lines - LONGEST_FUNCTION
    too_long = {key: over for key, over in found.items() if over > 0 and key not in LONG}
    assert not too_long, f"lines over the limit: {too_long}"


def test_random_numbers_come_from_one_place():
    calls = re.compile(r"torch\.(rand|randn|randint|randperm|normal|bernoulli|multinomial|rand_like|randn_like)\(")
    found = [str(p.relative_to(ROOT)) for p in SOURCES if calls.search(p.read_text())]
    assert found == ["torchms/sampling/uniforms.py"]


def test_files_of_others_are_read_in_one_place():
    """Where sizes are checked before they are believed."""
    calls = re.compile(r"Image\.open\(|\btrimesh\.load|\bnp\.(load|fromfile|memmap|genfromtxt|loadtxt)\(")
    found = [str(p.relative_to(ROOT)) for p in SOURCES if calls.search(p.read_text())]
    assert found == ["torchms/storage/archives.py", "torchms/storage/media.py"]


def test_every_citation_has_a_source():
    page = (ROOT / "docs" / "references.md").read_text()
    sources = set(CITATION.findall(page[page.index("## Sources") :]))
    cited = {key: str(p.relative_to(ROOT)) for p in SOURCES for key in CITATION.findall(p.read_text())}
    missing = {key: where for key, where in cited.items() if key not in sources}
    assert not missing, f"not in docs/references.md, Sources: {missing}"
    assert len(cited) >= 10, "the pattern finds no citations"


def test_nothing_is_unpickled():
    """No pickle, and no loader that is allowed to; tests may pickle what they made themselves."""
    unsafe = re.compile(
        r"^\s*(import|from) (pickle|dill|cloudpickle|joblib|shelve|marshal)\b|allow_pickle\s*=\s*True"
        r"|weights_only\s*=\s*False|\btorch\.load\((?!.*weights_only=True)|\bnp\.load\((?!.*allow_pickle=False)"
        r"|\byaml\.(unsafe_)?load\(|(?<![.\w])(eval|exec)\(",
        re.M,
    )
    files = [
        *SOURCES,
        *(ROOT / "export").rglob("*.py"),
        *(ROOT / "benchmarks").rglob("*.py"),
        *(ROOT / "tools").rglob("*.py"),
    ]
    found = {str(p.relative_to(ROOT)): m.group().strip() for p in files if (m := unsafe.search(p.read_text()))}
    assert not found
    for line in ("np.load(f, allow_pickle=True)", "np.load(f)", "torch.load(f)", "import pickle"):
        assert unsafe.search(line)


# Public classes and the tables.

ABSTRACT = {"BSDF", "MicrofacetDistribution", "EllipticDistribution", "Scattering", "Segment", "Fresnel", "Interface"}
ABSTRACT |= {"PathTracer", "FirstAndRest", "Compensated"}

ELSEWHERE = {
    "RandomHeight": ("unit/test_segment.py", "what HeightWalk, which is in the tables, holds"),
    "MetallicRoughness": (
        "unit/test_metallic_roughness.py",
        "a sum of lobes, which takes no distribution and no scattering",
    ),
    "Whitened": ("unit/test_metallic_roughness.py", "the scattering of that sum"),
    "Stream": ("unit/test_stream.py", "random numbers, no object of the theory"),
}
"""Public classes that no table holds: the file that has their laws, and why."""


@cache
def public_classes() -> dict[str, type]:
    """Every concrete class of the theory that a user can build, wherever it was defined in the package."""
    for info in pkgutil.walk_packages(torchms.__path__, "torchms."):
        if "__main__" not in info.name:
            importlib.import_module(info.name)
    roots: list[type] = [torchms.BSDF, torchms.MicrofacetDistribution, torchms.Scattering, torchms.Segment]
    pending: list[type] = [*roots, fresnel.Fresnel]
    found = {}
    while pending:
        cls = pending.pop()
        pending += cls.__subclasses__()
        if cls.__module__.startswith("torchms.") and cls.__name__ not in ABSTRACT and not cls.__name__.startswith("_"):
            found[cls.__name__] = cls
    exported = [getattr(module, name) for module in (torchms, fresnel) for name in dir(module)]
    classes = [c for c in exported if inspect.isclass(c) and not issubclass(c, tuple)]
    return found | {c.__name__: c for c in classes if c.__name__ not in ABSTRACT}


@cache
def tabled() -> set[type]:
    """The classes of everything that the tables build, parts included."""
    objects: list[nn.Module] = [make(0.5) for make in cases.DISTRIBUTIONS.values()]
    objects += [segment() for segment in cases.SEGMENTS.values()]
    objects += [fresnel_term() for fresnel_term in cases.FRESNELS.values()]
    objects += [make(2) for make in cases.EVERY_SCATTERING.values()]
    objects += [cases.bsdf(material, "single") for material in cases.MATERIALS]
    return {type(part) for thing in objects for part in thing.modules()}


def test_every_public_class_is_in_the_tables():
    classes = public_classes()
    assert {"GGX", "GTR", "HeightWalk", "RoughDiffuse", "Turquin", "Schlick", "Invariance"} <= classes.keys()
    missing = [name for name, cls in classes.items() if cls not in tabled() and name not in ELSEWHERE]
    assert not missing, f"no law holds {missing} to account: give them a line in tests/cases.py"


@pytest.mark.parametrize("name", ELSEWHERE)
def test_what_is_tested_elsewhere_is(name):
    path, _ = ELSEWHERE[name]
    assert name in public_classes() and re.search(rf"\b{name}\(", (ROOT / "tests" / path).read_text())


@pytest.mark.parametrize("name", sorted(ABSTRACT))
def test_what_is_excused_as_abstract_is_a_base(name):
    bases = {base.__name__ for cls in tabled() for base in cls.__mro__[1:]}
    assert name in bases and name not in {cls.__name__ for cls in tabled()}


def test_the_namespace_is_complete():
    """Whatever a package of the theory offers as public, `torchms` or `torchms.fresnel` offers too."""
    offered = {*dir(torchms), *dir(fresnel)}
    hidden = [name for name in public_classes() if name not in offered | {"RandomHeight", "Whitened"}]
    assert not hidden
