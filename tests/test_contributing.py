"""The code of CONTRIBUTING.md runs, and its distribution holds the laws, inside a surface as well."""

import re
from pathlib import Path
from typing import Any

import torch

from torchms import GGX, RoughConductor
from torchms.fresnel import Ideal
from torchms.testing import law_suite

PAGE = (Path(__file__).parent.parent / "CONTRIBUTING.md").read_text()


def executed() -> dict[str, Any]:
    """What the page's code defines."""
    (example,) = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    names: dict[str, Any] = {"__name__": "contributing"}
    exec(compile(example, "CONTRIBUTING.md", "exec"), names)
    return names


def test_the_code_runs() -> None:
    names = executed()
    assert len(names["report"].laws) > 10 and not names["report"].failed
    brushed, wi = names["brushed"], torch.tensor([0.6, 0.0, 0.8])
    value = brushed(wi, torch.tensor([-0.6, 0.0, 0.8]), brushed.uniforms((64, 64)))
    assert value.shape == (64, 64, 3) and bool((value > 0).all())


def test_the_laws_would_tell() -> None:
    """A sampler that turns the wrong way is found."""
    names = executed()

    class Wrong(names["Turned"]):
        def visible_normal(self, w: Any, u0: torch.Tensor, u1: torch.Tensor) -> Any:
            return self.turned(super().visible_normal(w, u0, u1), 1)

    failed = law_suite(Wrong(GGX(0.6, 0.3), 0.5), samples=5000).failed
    assert failed and all("sample_visible" in law.name for law in failed)


def test_a_quarter_turn_swaps_the_axes() -> None:
    names = executed()
    turned = RoughConductor(names["Turned"](GGX(0.6, 0.3), torch.pi / 2), Ideal()).double()
    swapped = RoughConductor(GGX(0.3, 0.6), Ideal()).double()
    wi = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    wo = torch.nn.functional.normalize(torch.tensor([[0.1, 0.3, 0.9], [-0.5, 0.2, 0.4]], dtype=torch.float64), dim=-1)
    orders = [bsdf.orders(wi, wo, bsdf.uniforms((2,), 8)) for bsdf in (turned, swapped)]
    # One bounce has no noise; it is the first of these orders.
    torch.testing.assert_close(orders[0][:, 0], orders[1][:, 0], rtol=1e-6, atol=0.0)


def test_the_page_is_one_page() -> None:
    assert len(PAGE.splitlines()) <= 80
