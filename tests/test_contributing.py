"""The code of CONTRIBUTING.md runs, and what it adds holds the laws; it is public after a file and a line for each class."""

import ast
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch

import torchms
from torchms import GGX, RoughConductor
from torchms.fresnel import Ideal
from torchms.testing import law_suite

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "CONTRIBUTING.md").read_text()

WALKS: list[str] = re.findall(r"```python\n(.*?)```", PAGE, re.S)


@cache
def definitions() -> dict[str, Any]:
    """The classes of the page."""
    names: dict[str, Any] = {"__name__": "contributing"}
    tree = ast.parse("".join(WALKS))
    tree.body = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom | ast.ClassDef)]
    exec(compile(tree, "CONTRIBUTING.md", "exec"), names)
    return names


@cache
def executed() -> dict[str, Any]:
    """All that the page's code makes; the reports of its three walks, in their order, as `reports`."""
    names: dict[str, Any] = {"__name__": "contributing", "reports": []}
    torch.manual_seed(0)
    for walk in WALKS:
        exec(compile(walk, "CONTRIBUTING.md", "exec"), names)
        names["reports"].append(names["report"])
    return names


def test_the_code_runs() -> None:
    names = executed()
    assert len(names["reports"]) == 3
    assert all(len(report.laws) > 10 and not report.failed for report in names["reports"])
    brushed, wi = names["brushed"], torch.tensor([0.6, 0.0, 0.8])
    value = brushed(wi, torch.tensor([-0.6, 0.0, 0.8]), brushed.uniforms((64, 64)))
    assert value.shape == (64, 64, 3) and bool((value > 0).all())


def test_the_laws_would_tell() -> None:
    """A sampler that turns the wrong way is found."""
    names = definitions()

    class Wrong(names["Turned"]):
        def visible_normal(self, w: Any, u0: torch.Tensor, u1: torch.Tensor) -> Any:
            return self.turned(super().visible_normal(w, u0, u1), 1)

    failed = law_suite(Wrong(GGX(0.6, 0.3), 0.5), samples=5000).failed
    assert failed and all("sample_visible" in law.name for law in failed)


def test_a_quarter_turn_swaps_the_axes() -> None:
    names = definitions()
    turned = RoughConductor(names["Turned"](GGX(0.6, 0.3), torch.pi / 2), Ideal()).double()
    swapped = RoughConductor(GGX(0.3, 0.6), Ideal()).double()
    wi = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    wo = torch.nn.functional.normalize(torch.tensor([[0.1, 0.3, 0.9], [-0.5, 0.2, 0.4]], dtype=torch.float64), dim=-1)
    orders = [bsdf.orders(wi, wo, bsdf.uniforms((2,), 8)) for bsdf in (turned, swapped)]
    # One bounce has no noise; it is the first of these orders.
    torch.testing.assert_close(orders[0][:, 0], orders[1][:, 0], rtol=1e-6, atol=0.0)


def test_the_dip_is_where_it_is_said_to_be() -> None:
    F82, Schlick = definitions()["F82"], torchms.fresnel.Schlick
    c = torch.linspace(0, 1, 701, dtype=torch.float64)
    f0, tint = torch.tensor([0.9, 0.3], dtype=torch.float64), torch.tensor([0.5, 0.8], dtype=torch.float64)
    share = F82(f0, tint)(c) / Schlick(f0)(c)
    torch.testing.assert_close(share[100], tint)
    torch.testing.assert_close(share[[0, -1]], torch.ones(2, 2, dtype=torch.float64))
    torch.testing.assert_close(F82(f0, torch.ones(2, dtype=torch.float64))(c), Schlick(f0)(c))


def test_each_walk_is_one_page() -> None:
    head, *walks = PAGE.split("## How to add ")
    assert len(head.splitlines()) <= 20 and len(walks) == 3
    assert all(len(walk.splitlines()) <= 70 for walk in walks)


HOMES = {"Turned": "distributions", "F82": "fresnel", "LearnedRest": "approximations"}
"""The package of each class of the page."""


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository in which the classes of the page are public: a file and a line each, and the documentation."""
    tree = tmp_path_factory.mktemp("contributing") / "tree"
    kept = shutil.ignore_patterns("__pycache__", "node_modules", ".*")
    for name in ("torchms", "tests", "docs"):
        shutil.copytree(ROOT / name, tree / name, ignore=kept)
    for name in ("README.md", "CONTRIBUTING.md", "CITATION.cff", "setup.cfg"):
        shutil.copy(ROOT / name, tree / name)
    code = ast.parse("".join(WALKS))
    for name, package in HOMES.items():
        (node,) = (node for node in code.body if isinstance(node, ast.ClassDef) and node.name == name)
        used = {inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)}
        needed = [
            f"from {definitions()[n].__module__} import {n}" for n in used if n[0].isupper() and n in definitions()
        ]
        needed += [
            f"from {definitions()[n].__module__} import {n}" for n in ("channels_first", "from_front") if n in used
        ]
        node.body.insert(1, ast.parse("sources = ('Heitz2014',)").body[0])
        source = "\n".join(["import math", "import torch", "from torch import nn", *needed, "", ast.unparse(node), ""])
        home = tree / "torchms" / package
        (home / f"{name.lower()}.py").write_text(f'"""{ast.get_docstring(node)}"""\n\n{source}')
        with (home / "__init__.py").open("a") as offered:
            offered.write(f"from torchms.{package}.{name.lower()} import {name} as {name}\n")
        with (tree / "docs" / "api.md").open("a") as page:
            page.write(f".. autoclass:: torchms.{package}.{name}\n.. autoclass:: torchms.{name}\n" * (name != "F82"))
            page.write(".. autoclass:: torchms.fresnel.F82\n" * (name == "F82"))
    return tree


def done_in(tree: Path, *arguments: str) -> str:
    """What a Python program prints that runs in `tree`; it must succeed."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=tree,
        env=os.environ | {"PYTHONPATH": f"{tree}{os.pathsep}{tree / 'tests'}", "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    return done.stdout


def test_each_is_public_after_a_file_and_a_line(tree: Path) -> None:
    """In `torchms`, in what --bsdf takes, and in the tables of the laws."""
    program = """if True:
        import cases, torchms
        from torchms.cli import parse_bsdf
        surface = parse_bsdf("RoughConductor(Turned(GGX(0.6, 0.3), 0.5), F82([0.9], [0.7]), LearnedRest(4))")
        assert type(surface.distribution) is torchms.Turned and type(surface.fresnel) is torchms.fresnel.F82
        assert type(surface.scattering) is torchms.LearnedRest is torchms.approximations.LearnedRest
        assert {"Turned", "LearnedRest"} <= {*dir(torchms)} and "F82" not in dir(torchms)
        found = [cases.DISTRIBUTIONS["turned"](0.5), cases.FRESNELS["f82"](), cases.OTHERS["learnedrest"](4)]
        print(*(type(each).__name__ for each in found), torchms.cite(surface).count("[Heitz2014]"))
    """
    assert done_in(tree, "-c", program).split() == ["Turned", "F82", "LearnedRest", "1"]


@pytest.mark.slow
def test_the_laws_of_the_tables_hold_for_each(tree: Path) -> None:
    """Of the shape of the package, of the documentation, and those that the tables are for."""
    tests = ["-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done_in(tree, *tests, *(f"tests/test_{name}.py" for name in ("layout", "docs", "law_table", "citations")))
    units = [f"tests/unit/test_{name}.py" for name in ("law_suite", "masking", "vertex")]
    done_in(tree, *tests, "-m", "not slow", *units, "-k", "turned or f82 or learnedrest")
    done_in(tree, *tests, "tests/onnx/test_files.py", "-k", "every_distribution and turned")


@pytest.mark.slow
def test_type_checkers_know_each(tree: Path) -> None:
    """And that there is nothing of another name."""
    lines = ("import torchms", "reveal_type(torchms.Turned)", "reveal_type(torchms.fresnel.F82)", "torchms.Turnde")
    (tree / "asked.py").write_text("\n".join(lines) + "\n")
    done = subprocess.run(
        [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "asked.py"],
        cwd=tree,
        capture_output=True,
        text=True,
        check=False,
    )
    for said in ('"type[Turned]"', '"type[F82]"', '"Turnde" is not a known attribute', "1 error"):
        assert said in done.stdout, done.stdout
