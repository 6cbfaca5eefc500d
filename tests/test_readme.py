"""What the README shows runs, and what it points at exists."""

import re
from pathlib import Path

README = Path(__file__).parent.parent / "README.md"


def test_python_examples_run() -> None:
    examples = re.findall(r"```python\n(.*?)```", README.read_text(), re.S)
    assert examples
    for example in examples:
        assert len([line for line in example.splitlines() if line]) <= 15, "ten lines and their imports"
        exec(compile(example, "README.md", "exec"), {})


def test_names_the_two_commands() -> None:
    text = README.read_text()
    assert "make demo" in text and "make test" in text


def test_it_is_short() -> None:
    assert len(README.read_text().splitlines()) <= 150


def test_every_link_leads_to_a_file() -> None:
    """And to a heading of it, where one is named."""
    text = README.read_text()
    links = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'src="([^"]+)"', text)
    assert len(links) > 20 and "docs/images/hero.png" in links
    for link in links:
        path, _, heading = link.partition("#")
        file = README.parent / path
        assert file.is_file(), link
        titles = (
            [line.lstrip("# ").lower().replace(" ", "-") for line in file.read_text().splitlines() if line[:1] == "#"]
            if heading
            else [""]
        )
        assert heading in titles, link
