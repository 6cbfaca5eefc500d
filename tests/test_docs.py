"""The API pages leave nothing public out; `make docs` builds them, with warnings as errors."""

import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

import torchms

DOCS = Path(__file__).parent.parent / "docs"
PAGE = "\n".join(page.read_text() for page in [DOCS / "api.md", *sorted((DOCS / "api").glob("*.md"))])
PARTS = tuple(name for name in torchms._MODULES if name != "testing")
PACKAGES = ("torchms", *(f"torchms.{part}" for part in PARTS))
NAMED = set(re.findall(r"\.\. auto\w+:: ([\w.]+)", PAGE))


def test_every_public_name_has_an_entry() -> None:
    for package in PACKAGES:
        module = import_module(package)
        for name in getattr(module, "__all__", dir(module)):
            public = getattr(module, name)
            if not (inspect.ismodule(public) or name.startswith("_")):
                assert {f"{package}.{name}", f"torchms.{name}"} & NAMED, f"{package}.{name} is not in docs/api/"


@pytest.mark.parametrize("path", sorted(NAMED))
def test_every_entry_exists_and_is_described(path: str) -> None:
    try:
        public = import_module(path)
    except ImportError:
        home, _, name = path.rpartition(".")
        public = getattr(import_module(home), name)
    assert public.__doc__, path
