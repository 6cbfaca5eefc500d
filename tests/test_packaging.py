"""What is distributed: whole, described, and enough by itself."""

import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from email import message_from_string
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import torchms

ROOT = Path(__file__).parent.parent
NAME = f"torchms-{torchms.__version__}"
URL = "https://example.org/somebody/torchms"


def repository(folder: Path) -> Path:
    """A copy of what a commit holds: nothing that is built."""
    left_out = ("__pycache__", "node_modules", ".*", "build", "dist", "*.egg-info", "models", "gallery")
    return Path(shutil.copytree(ROOT, folder / "tree", ignore=shutil.ignore_patterns(*left_out)))


def run(*arguments: str, cwd: Path) -> str:
    done = subprocess.run(arguments, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_a_release_knows_where_it_is(tmp_path: Path) -> None:
    """`tools.address` makes every link of the README an address, and may be run again."""
    from tools.address import write

    for name in ("README.md", "setup.cfg", "CITATION.cff"):
        shutil.copy(ROOT / name, tmp_path / name)
    write(tmp_path, URL)
    once = [(tmp_path / name).read_text() for name in ("README.md", "setup.cfg", "CITATION.cff")]
    write(tmp_path, URL + "/")
    assert once == [(tmp_path / name).read_text() for name in ("README.md", "setup.cfg", "CITATION.cff")]
    links = re.findall(r'(?:\]\(|src=")([^)"\s]+)', once[0])
    assert len(links) > 20 and all(link.startswith(f"{URL}/") for link in links)
    assert f"{URL}/raw/v{torchms.__version__}/docs/images/hero.png" in links
    assert f"    Source = {URL}\n" in once[1] and f'repository-code: "{URL}"\n' in once[2]
    with pytest.raises(ValueError, match="https://host/owner/name"):
        write(tmp_path, "torchms")


def test_messages_about_extras_name_extras_that_exist() -> None:
    setup = (ROOT / "setup.cfg").read_text().split("[options.extras_require]")[1].split("\n[")[0]
    extras = dict(re.findall(r"^(\w+) =\n((?:    .+\n)+)", setup + "\n", re.M))
    from torchms.extras import EXTRA

    for package, extra in EXTRA.items():
        assert re.search(rf"^    {package}\b", extras[extra], re.M | re.I), (package, extra)
    said = [
        (file.name, line)
        for file in (ROOT / "torchms").rglob("*.py")
        for line in re.findall(r"pip install.*", file.read_text())
        if not re.match(r'pip install "torchms\[', line)
    ]
    assert not said


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of sdist and wheel."""
    if find_spec("build") is None or find_spec("setuptools") is None:
        pytest.skip("needs build and setuptools: pip install build setuptools")
    tree = repository(tmp_path_factory.mktemp("build"))
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tree / "dist"), cwd=tree)
    return tree / "dist"


@pytest.mark.slow
def test_the_sdist_is_the_repository(built: Path) -> None:
    with tarfile.open(built / f"{NAME}.tar.gz") as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    there = {str(path.relative_to(built.parent)) for path in built.parent.rglob("*") if path.is_file()}
    made = re.compile(r"(dist|build|torchms\.egg-info|docs/figures)/|.*/\.")
    assert {"tests/cases.py", "tests/conftest.py", "MANIFEST.in", "docs/theory.md"} <= inside
    assert not {name for name in there - inside if not made.match(name)}


@pytest.mark.slow
def test_the_wheel_is_the_package(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        inside = set(archive.namelist())
        metadata = message_from_string(archive.read(f"{NAME}.dist-info/METADATA").decode())
    needed = {str(path.relative_to(ROOT)) for path in (ROOT / "torchms").rglob("*") if path.is_file()}
    needed = {name for name in needed if "__pycache__" not in name}
    assert needed <= inside and "torchms/py.typed" in inside
    assert {name.partition("/")[0] for name in inside} == {"torchms", f"{NAME}.dist-info"}
    assert metadata["Author"] == "torchms developers" and "BSDF" in metadata["Keywords"]
    assert metadata["Requires-Python"] == ">=3.11" and metadata["License"] == "MIT"


@pytest.mark.slow
def test_an_index_takes_them(built: Path) -> None:
    if find_spec("twine") is None:
        pytest.skip("needs twine: pip install twine")
    said = run(sys.executable, "-m", "twine", "check", "--strict", *map(str, built.iterdir()), cwd=built)
    assert said.count("PASSED") == 2


@pytest.mark.slow
def test_who_works_beside_a_clone_imports_the_package(tmp_path: Path) -> None:
    """A clone is a folder named torchms, which Python takes for a package of that name if nothing else is found first."""
    if find_spec("setuptools") is None:
        pytest.skip("needs setuptools: pip install setuptools")
    clone = repository(tmp_path).rename(tmp_path / "torchms")
    run(
        sys.executable,
        "-c",
        f"from setuptools.build_meta import build_editable; build_editable({str(tmp_path)!r})",
        cwd=clone,
    )
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    script = tmp_path / "own.py"
    script.write_text("import site, sys; site.addsitedir(sys.argv[1]); import torchms; print(torchms.__file__)")
    assert run(sys.executable, "-S", str(script), str(site), cwd=tmp_path).strip() == str(
        clone / "torchms" / "__init__.py"
    )


def closure(name: str, found: set[str]) -> set[str]:
    """The installed distributions that this one needs without extras, itself among them."""
    if name not in found:
        found.add(name)
        for text in distribution(name).requires or ():
            needed = Requirement(text)
            if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                closure(needed.name, found)
    return found


@pytest.mark.slow
def test_the_readme_runs_without_extras(built: Path, tmp_path: Path) -> None:
    """In an environment of its own, where nothing is but the wheel and what it asks for."""
    (wheel,) = built.glob("*.whl")
    required = tmp_path / "required"
    required.mkdir()
    found: set[str] = set()
    for name in ("torch", "numpy", "jaxtyping", "rich", "tyro"):
        closure(name, found)
    for name in found:
        for file in distribution(name).files or ():
            top = required / file.parts[0]
            if file.parts[0] not in ("..", "__pycache__") and not top.exists():
                top.symlink_to(Path(str(distribution(name).locate_file(file.parts[0]))))
    venv.create(tmp_path / "empty", with_pip=True)
    python = tmp_path / "empty" / "bin" / "python"
    site = Path(run(str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=tmp_path).strip())
    run(str(python), "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", str(wheel), cwd=tmp_path)
    (site / "required.pth").write_text(f"{required}\n")
    first = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)[0]
    assert "of the light" in run(str(python), "-c", first, cwd=tmp_path)
    assert not {"numba", "onnx", "matplotlib", "PIL"} & {path.name for path in required.iterdir()}
    command = tmp_path / "empty" / "bin" / "torchms"
    assert torchms.__version__ in run(str(command), "--version", cwd=tmp_path)
    said = subprocess.run([command, "simulate"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert said.returncode == 2 and 'pip install "torchms[microsurface]"' in said.stderr
