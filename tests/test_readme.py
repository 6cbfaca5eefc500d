"""What the README shows runs."""

import re
from pathlib import Path

README = Path(__file__).parent.parent / "README.md"


def test_python_examples_run() -> None:
    examples = re.findall(r"```python\n(.*?)```", README.read_text(), re.S)
    assert examples
    for example in examples:
        assert len(example.strip().splitlines()) <= 13, "the twelve-line example"
        exec(compile(example, "README.md", "exec"), {})


def test_names_the_two_commands() -> None:
    text = README.read_text()
    assert "make demo" in text and "make test" in text
