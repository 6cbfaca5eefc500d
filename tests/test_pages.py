"""The code of the documentation runs, its links lead somewhere, and the tables that programs write have their places."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent / "docs"
PAGES = sorted(DOCS.glob("*.md"))
EXAMPLES = [(page.name, code) for page in PAGES for code in re.findall(r"```python\n(.*?)```", page.read_text(), re.S)]


@pytest.mark.parametrize(("page", "code"), EXAMPLES, ids=[page for page, _ in EXAMPLES])
def test_code_runs(page: str, code: str) -> None:
    exec(compile(code, page, "exec"), {"__name__": "page"})


def test_some_pages_have_code() -> None:
    assert {"conventions.md", "distilled.md", "fitting.md", "metallic_roughness.md"} <= {page for page, _ in EXAMPLES}


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_links_lead_to_files(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if not link.startswith("http"):
            assert (DOCS / link.partition("#")[0]).is_file() or link.startswith("#"), link


def test_every_picture_is_shown() -> None:
    """In a page or the README; a picture that nothing shows is left over."""
    text = "".join(page.read_text() for page in [*DOCS.rglob("*.md"), DOCS.parent / "README.md"])
    unseen = [path.name for path in (DOCS / "images").glob("*.png") if path.name not in text]
    assert not unseen
