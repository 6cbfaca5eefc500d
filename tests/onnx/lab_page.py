"""The lobe lab as the tests build, serve and drive it."""

import json
import os
import shutil
import subprocess
import threading
from pathlib import Path
from typing import Any

import pytest

from torchms.cli.lab import server

ROOT = Path(__file__).parents[2]
LAB = ROOT / "export" / "lab"
LISTING = LAB / "public" / "models" / "models.json"
LOBES = ROOT / "torchms" / "approximations"


def chromium() -> str | None:
    places = (os.environ.get("CHROMIUM"), "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome")
    return next((place for place in places if place and Path(place).exists()), None)


def build(folder: Path) -> Path:
    """The page as it is now, with the evaluators that `make lab` wrote; the test is skipped where something is missing."""
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        pytest.skip("node is not installed")
    if chromium() is None:
        pytest.skip("there is no Chromium: apt-get install chromium, or name one in $CHROMIUM")
    if not (LAB / "node_modules" / "playwright-core").is_dir():
        pytest.skip("the lab's packages are not installed: npm ci --ignore-scripts --prefix export/lab")
    if not LISTING.is_file():
        pytest.skip("the lab's evaluators are not written: make lab (about 20 minutes of one core, once)")
    written = LISTING.stat().st_mtime
    if any(file.stat().st_mtime > written for file in LOBES.glob("distilled_*.npz")):
        pytest.skip("the lab's evaluators are older than the lobes in the package: make lab")
    command = [npm, "run", "build", "--prefix", str(LAB), "--", "--outDir", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    return folder


def driven(built: Path, script: str, *arguments: str) -> Any:
    """What a script of export/lab/drive prints of the page as its last line."""
    with server(built, 0) as running:
        threading.Thread(target=running.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{running.server_address[1]}/"
        command = ["node", str(LAB / "drive" / script), url, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
        running.shutdown()
    assert done.returncode == 0, done.stderr[-4000:]
    return json.loads(done.stdout.splitlines()[-1])
