"""The faults of `make mutations` are still possible: a formula that was written anew would leave its fault without a line."""

import pytest
from mutations import FAULTS, ROOT


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_line_of_a_fault_is_there_once(fault) -> None:
    assert (ROOT / "torchms" / fault.file).read_text().count(fault.right) == 1
    assert fault.right != fault.wrong and (ROOT / fault.tests[0].partition("::")[0]).is_file()


def test_the_page_counts_them() -> None:
    numbers = {24: "twenty-four", 25: "twenty-five", 26: "twenty-six", 27: "twenty-seven", 28: "twenty-eight"}
    assert f"breaks {numbers[len(FAULTS)]} formulas" in (ROOT / "docs" / "trust.md").read_text()
