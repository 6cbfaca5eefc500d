"""docs/theory.md: what cites it finds its section, what it names is there, and nothing cites what is not shipped."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "theory.md").read_text()
SECTIONS = set(re.findall(r"^## (\d+)\. ", PAGE, re.M))
FILES = [path for folder in ("torchms", "tests", "tools", "benchmarks") for path in (ROOT / folder).rglob("*.py")]


def test_every_citation_finds_its_section() -> None:
    cited = [number for path in FILES for number in re.findall(r"docs/theory\.md, section (\d+)", path.read_text())]
    assert len(cited) >= 5 and set(cited) <= SECTIONS


def test_nothing_cites_what_is_not_in_the_repository() -> None:
    # Written in two pieces, or this file would be found.
    elsewhere = re.compile(r"\b(" + "THEO" + r"RY|FA" + r"CTS)\b")
    assert not [str(path.relative_to(ROOT)) for path in FILES if elsewhere.search(path.read_text())]


def test_its_sources_are_those_of_the_readme() -> None:
    sources = (ROOT / "docs" / "references.md").read_text().split("## Sources")[1]
    listed = set(re.findall(r"^- \[(\w+\d{4})\]", sources, re.M))
    cited = set(re.findall(r"\[([A-Z]\w+\d{4})[\],]", PAGE))
    assert len(cited) > 8 and cited <= listed


def test_what_it_names_exists() -> None:
    for path in re.findall(r"`(tests/[\w/]+\.py)`", PAGE):
        assert (ROOT / path).is_file(), path
    for module in re.findall(r"`torchms\.([\w.]+)`", PAGE):
        assert (ROOT / "torchms" / module.replace(".", "/")).with_suffix(".py").is_file(), module
