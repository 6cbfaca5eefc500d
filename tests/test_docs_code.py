"""Every block of code in the pages of docs/ runs: Python as it stands, commands, JavaScript; one name space a page, in an
empty folder. What takes long is marked slow."""

import ast
import contextlib
import importlib.util
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import tyro

from torchms.cli.commands import COMMANDS, main
from torchms.microsurface import Heightfield
from torchms.mitsuba import find_llvm

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = {
    str(page.relative_to(DOCS)): page.read_text()
    for page in sorted(DOCS.rglob("*.md"))
    if "gallery" not in page.relative_to(DOCS).parts
}
SLOW = {
    "compiled.md": "machine code",
    "howto/add_distribution.md": "a suite of laws",
    "howto/checkpoints.md": "a simulation",
    "howto/compile.md": "machine code of seven programs",
    "howto/mitsuba.md": "Mitsuba",
    "mitsuba.md": "Mitsuba",
    "surface_lobes.md": "a distillation",
    "tutorials/gbuffer_fit.md": "two fits",
    "tutorials/onnx.md": "two exports",
    "tutorials/own_scan.md": "a simulation",
}
"""Pages that take more than a second or two, and what with."""


def scan() -> None:
    """The file of lobes that a command of the page makes, in a thousandth of its time."""
    surface = Heightfield.gaussian(0.4, size=128, seed=1, texels_per_correlation=16)
    np.save("scan.npy", surface.heights)
    units = ["--spacing", str(surface.spacing[0]), "--height-scale", "1", "--periodic"]
    effort = ["--paths", "2e4", "--steps", "2", "--held-out", "2e3"]
    assert main(["distil", "--surface", "scan.npy", *units, *effort, "--out", "scan.npz"]) == 0


BEFORE = {"surface_lobes.md": scan}
"""What stands for commands of a page that would take too long."""


def blocks(text: str, *languages: str) -> list[str]:
    """The fenced blocks of these languages, "" for none."""
    fences = re.findall(r"^ *```([^\n]*)\n(.*?)^ *```$", text, re.S | re.M)
    return [code for language, code in fences if language.strip() in languages]


def commands(text: str) -> list[list[str]]:
    """Lines of blocks that are commands, as words; a line goes on after a backslash, `#` begins a comment."""
    lines = "\n".join(blocks(text, "", "console", "bash")).replace("\\\n", " ").splitlines()
    words = [shlex.split(line, comments=True) for line in lines if re.match(r"(torchms|make|python|pip) ", line)]
    return [each for each in words if each]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, in which the code runs."""
    monkeypatch.chdir(tmp_path)
    torch.manual_seed(0)
    return tmp_path


def run_python(page: str) -> dict[str, Any]:
    """The names that the Python of a page leaves; what sets a variant of Mitsuba runs in a process of its own."""
    BEFORE.get(page, lambda: None)()
    names: dict[str, Any] = {"__name__": "page"}
    codes = blocks(PAGES[page], "python")
    if any("import mitsuba as mi" in code for code in codes):
        pytest.importorskip("mitsuba", reason='needs Mitsuba 3: pip install "torchms[mitsuba]"')
        if find_llvm() is None and any('"llvm_ad_rgb")\n' in code for code in codes):
            pytest.skip("needs an LLVM of version 17 or later (Debian: libllvm19)")
        subprocess.run([sys.executable, "-c", "".join(codes)], cwd=ROOT, check=True, timeout=300)
        return names
    for code in codes:
        exec(compile(code, page, "exec"), names)
    return names


WITH_PYTHON = [
    pytest.param(page, marks=[pytest.mark.slow] if page in SLOW else [])
    for page, text in PAGES.items()
    if blocks(text, "python")
]


@pytest.mark.usefixtures("messages")
@pytest.mark.parametrize("page", WITH_PYTHON)
def test_python_runs(page: str, folder: Path) -> None:
    """Then the commands of a slow page that are marked as `console`, in the same folder."""
    run_python(page)
    for line in commands("\n".join(f"```console\n{code}```" for code in blocks(PAGES[page], "console"))):
        if page in SLOW and line[0] == "torchms":
            assert main(line[1:]) == 0, line


def test_the_tutorials_and_the_theory_have_code() -> None:
    missing = [p for p in PAGES if p.startswith(("tutorials/", "theory/", "howto/")) and not blocks(PAGES[p], "python")]
    assert not missing and len(PAGES) > 30 and set(SLOW) <= set(PAGES)


@pytest.mark.parametrize("page", PAGES)
def test_what_is_python_says_so(page: str) -> None:
    """A block without a language that imports something would not be run."""
    for code in blocks(PAGES[page], "", "text"):
        with contextlib.suppress(SyntaxError):
            nodes = ast.walk(ast.parse(code))
            assert not any(isinstance(node, ast.Import | ast.ImportFrom) for node in nodes), code


LANGUAGES = {"", "python", "console", "bash", "text", "javascript", "glsl", "{eval-rst}", "bibtex", "json", "xml"}


@pytest.mark.parametrize("page", PAGES)
def test_every_language_has_its_test(page: str) -> None:
    found = {language.strip() for language in re.findall(r"^ *```([^\n`]+)$", PAGES[page], re.M)}
    assert found <= LANGUAGES


@pytest.mark.parametrize("page", [page for page, text in PAGES.items() if commands(text)])
def test_commands_exist(page: str) -> None:
    """Options of torchms, targets of make, scripts and modules of Python, extras of pip."""
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M))
    setup = ConfigParser()
    setup.read(ROOT / "setup.cfg")
    for program, *words in commands(PAGES[page]):
        if program == "torchms":
            check_options(words)
        elif program == "make":
            assert set(words) <= targets, words
        elif program == "python" and words[0] == "-m":
            assert importlib.util.find_spec(words[1]) is not None, words
        elif program == "python":
            assert (ROOT / words[0]).is_file(), words
        else:
            extras = re.findall(r"torchms\[([\w,]+)\]", " ".join(words))
            assert set(",".join(extras).split(",")) - {""} <= set(setup["options.extras_require"]), words


def check_options(words: list[str]) -> None:
    """They fit; nothing is run."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            tyro.extras.subcommand_cli_from_dict({n: o for n, (o, _) in COMMANDS.items()}, prog="torchms", args=words)
    except SystemExit as stopped:
        assert stopped.code == 0, f"torchms {shlex.join(words)}\n{said.getvalue()}"


@pytest.mark.slow
def test_the_javascript_of_the_onnx_page(folder: Path) -> None:
    """Node prints what PyTorch computes."""
    packages = ROOT / "tests" / "onnx" / "node" / "node_modules"
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    if not (packages / "onnxruntime-node").is_dir():
        pytest.skip("onnxruntime-node is not installed: npm ci --ignore-scripts --prefix tests/onnx/node")
    names = run_python("tutorials/onnx.md")
    (script,) = blocks(PAGES["tutorials/onnx.md"], "javascript")
    (folder / "run.js").write_text(script.replace("console.log(value.dims, Array.from(value.data));", SAY))
    environment = os.environ | {"NODE_PATH": str(packages)}
    done = subprocess.run(
        [node, "run.js"], cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode and "Cannot find" in done.stderr:
        pytest.skip(f"onnxruntime-node has no binary for this machine: {done.stderr.splitlines()[0]}")
    assert done.returncode == 0, done.stderr
    wi, wo = torch.tensor([[0.6, 0, 0.8], [0, 0, 1]]), torch.tensor([[-0.6, 0, 0.8], [0, 0.6, 0.8]])
    expected = names["ms"].RoughConductor(
        names["ms"].GGX(torch.tensor([0.3, 0.6])), names["Conductor"].metal("Cu"), names["ms"].Distilled()
    )(wi, wo)
    torch.testing.assert_close(torch.tensor(json.loads(done.stdout)).reshape(2, 3), expected, rtol=1e-4, atol=1e-6)


SAY = "console.log(JSON.stringify(Array.from(value.data)));"
