"""The code of CONTRIBUTING.md runs, and what it adds holds the laws."""

import ast
import re
from functools import cache
from pathlib import Path
from typing import Any

import torch

import torchms
from torchms import GGX, RoughConductor
from torchms.fresnel import Ideal
from torchms.testing import law_suite

PAGE = (Path(__file__).parent.parent / "CONTRIBUTING.md").read_text()


WALKS: list[str] = re.findall(r"```python\n(.*?)```", PAGE, re.S)


@cache
def definitions() -> dict[str, Any]:
    """The classes of the page."""
    names: dict[str, Any] = {"__name__": "contributing"}
    tree = ast.parse("".join(WALKS))
    tree.body = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom | ast.ClassDef)]
    exec(compile(tree, "CONTRIBUTING.md", "exec"), names)
    return names


@cache
def executed() -> dict[str, Any]:
    """All that the page's code makes; the reports of its three walks, in their order, as `reports`."""
    names: dict[str, Any] = {"__name__": "contributing", "reports": []}
    torch.manual_seed(0)
    for walk in WALKS:
        exec(compile(walk, "CONTRIBUTING.md", "exec"), names)
        names["reports"].append(names["report"])
    return names


def test_the_code_runs() -> None:
    names = executed()
    assert len(names["reports"]) == 3
    assert all(len(report.laws) > 10 and not report.failed for report in names["reports"])
    brushed, wi = names["brushed"], torch.tensor([0.6, 0.0, 0.8])
    value = brushed(wi, torch.tensor([-0.6, 0.0, 0.8]), brushed.uniforms((64, 64)))
    assert value.shape == (64, 64, 3) and bool((value > 0).all())


def test_the_laws_would_tell() -> None:
    """A sampler that turns the wrong way is found."""
    names = definitions()

    class Wrong(names["Turned"]):
        def visible_normal(self, w: Any, u0: torch.Tensor, u1: torch.Tensor) -> Any:
            return self.turned(super().visible_normal(w, u0, u1), 1)

    failed = law_suite(Wrong(GGX(0.6, 0.3), 0.5), samples=5000).failed
    assert failed and all("sample_visible" in law.name for law in failed)


def test_a_quarter_turn_swaps_the_axes() -> None:
    names = definitions()
    turned = RoughConductor(names["Turned"](GGX(0.6, 0.3), torch.pi / 2), Ideal()).double()
    swapped = RoughConductor(GGX(0.3, 0.6), Ideal()).double()
    wi = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    wo = torch.nn.functional.normalize(torch.tensor([[0.1, 0.3, 0.9], [-0.5, 0.2, 0.4]], dtype=torch.float64), dim=-1)
    orders = [bsdf.orders(wi, wo, bsdf.uniforms((2,), 8)) for bsdf in (turned, swapped)]
    # One bounce has no noise; it is the first of these orders.
    torch.testing.assert_close(orders[0][:, 0], orders[1][:, 0], rtol=1e-6, atol=0.0)


def test_the_dip_is_where_it_is_said_to_be() -> None:
    F82, Schlick = definitions()["F82"], torchms.fresnel.Schlick
    c = torch.linspace(0, 1, 701, dtype=torch.float64)
    f0, tint = torch.tensor([0.9, 0.3], dtype=torch.float64), torch.tensor([0.5, 0.8], dtype=torch.float64)
    share = F82(f0, tint)(c) / Schlick(f0)(c)
    torch.testing.assert_close(share[100], tint)
    torch.testing.assert_close(share[[0, -1]], torch.ones(2, 2, dtype=torch.float64))
    torch.testing.assert_close(F82(f0, torch.ones(2, dtype=torch.float64))(c), Schlick(f0)(c))


def test_each_walk_is_one_page() -> None:
    head, *walks = PAGE.split("## How to add ")
    assert len(head.splitlines()) <= 20 and len(walks) == 3
    assert all(len(walk.splitlines()) <= 70 for walk in walks)
