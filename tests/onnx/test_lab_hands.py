"""The lobe lab under a mouse, the keyboard and a finger; skipped for the reasons of test_lab.py."""

from pathlib import Path
from typing import Any

import pytest
from lab_page import driven


@pytest.fixture(scope="module")
def used(built: Path) -> Any:
    """By hand and control, whether each did what it is for."""
    return driven(built, "walk.mjs")


@pytest.mark.slow
@pytest.mark.parametrize("hand", ["mouse", "keyboard", "touch"])
def test_every_control_answers(hand: str, used: Any) -> None:
    """Handles, camera and sliders move what they are for, every view gives a picture and numbers, nothing leaves the screen."""
    assert len(used[hand]) >= 10
    assert [control for control, does in used[hand].items() if not does] == []


@pytest.mark.slow
def test_a_dropped_file_is_drawn_or_gets_a_sentence(used: Any) -> None:
    assert used["dropped"] == {"foreign": True, "mine": True}
    assert used["errors"] == []
