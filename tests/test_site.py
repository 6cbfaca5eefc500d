"""The documentation as a reader has it: built without a warning, and looked through in a browser."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tools.check_site import faults
from tools.site_browser import find_chromium

ROOT = Path(__file__).parent.parent

PAGE = '<html><head><title>t</title></head><body><h1 id="top">Words that a page needs to be one</h1>{}</body></html>'


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ('<a href="other.html">x</a>', "there is no such file"),
        ('<a href="#gone">x</a>', "has no anchor 'gone'"),
        ('<a href="second.html#gone">x</a>', "has no anchor 'gone'"),
        ('<img src="none.png" alt="a thing">', "there is no such file"),
        ('<img src="real.png">', "does not say what it shows"),
        ('<img src="cut.png" alt="a thing">', "is not a whole PNG"),
        ('<a href="second.html#top">x</a><a href="https://example.org/x">x</a><img src="real.png" alt="a thing">', ""),
    ],
)
def test_what_is_broken_is_found(body: str, said: str, tmp_path: Path) -> None:
    picture = (ROOT / "docs" / "images" / "theory" / "path.png").read_bytes()
    (tmp_path / "real.png").write_bytes(picture)
    if "cut" in body:
        (tmp_path / "cut.png").write_bytes(picture[:2000])
    (tmp_path / "index.html").write_text(PAGE.format(body))
    (tmp_path / "second.html").write_text(PAGE.format(""))
    found = faults(tmp_path)
    assert bool(found) == bool(said) and all(said in fault for fault in found), found


@pytest.mark.slow
def test_the_site_is_whole(tmp_path: Path) -> None:
    """`make docs`, without running the gallery, and `make docs-check`."""
    for package in ("sphinx", "furo", "myst_parser", "sphinx_gallery"):
        pytest.importorskip(package, reason='needs pip install "torchms[docs]"')
    kept = shutil.ignore_patterns("gallery", "__pycache__")
    for name in ("docs", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=kept)
    built = tmp_path / "site"
    sphinx = ["-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet", "-b", "html", "-D", "plot_gallery=0"]
    done = subprocess.run(
        [sys.executable, *sphinx, str(tmp_path / "docs"), str(built)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1000,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    check = [sys.executable, "-m", "tools.check_site", str(built)]
    done = subprocess.run(check, cwd=ROOT, capture_output=True, text=True, timeout=1000, check=False)
    assert done.returncode == 0, done.stdout
    if find_chromium() is None:
        pytest.skip(
            f"built, and no link is broken; no Chromium to look at it (apt-get install chromium): {done.stdout}"
        )
    assert "search works" in done.stdout
