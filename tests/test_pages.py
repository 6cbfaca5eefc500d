"""The links of the documentation lead somewhere, and its pictures are shown; `test_docs_code.py` runs its code."""

import ast
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=[page.relative_to(DOCS).as_posix() for page in PAGES])
def test_links_lead_to_files(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if not link.startswith("http"):
            assert link.startswith(("#", "../gallery/")) or (page.parent / link.partition("#")[0]).is_file(), link


def test_every_picture_is_shown() -> None:
    """In a page or the README; a picture that nothing shows is left over."""
    text = "".join(page.read_text() for page in [*DOCS.rglob("*.md"), DOCS.parent / "README.md"])
    unseen = [path.name for path in (DOCS / "images").rglob("*.png") if path.name not in text]
    assert not unseen


EXAMPLES = [path for path in sorted((DOCS.parent / "examples").glob("*.py")) if path.name != "gbuffer.py"]


@pytest.mark.parametrize("example", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_examples_have_titles(example: Path) -> None:
    """Without one the gallery has no link to it."""
    title, line, *_ = (ast.get_docstring(ast.parse(example.read_text())) or "\n").splitlines()
    assert title and line == "=" * len(title)
