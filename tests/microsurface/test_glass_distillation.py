"""Distillations of surfaces of glass: blocks of light, integrals of narrow lobes, the commands from heights to a file."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from torchms import Beckmann, Distilled, RoughDielectric, Stream
from torchms.approximations.distil.glass_rows import Surfaces
from torchms.approximations.surface_correction import ORDERS
from torchms.cli import main
from torchms.fresnel import Dielectric
from torchms.microsurface import Heightfield
from torchms.microsurface.distil import __main__ as command
from torchms.microsurface.distil import fit, glass, glass_report, held_out, light, scan

pytestmark = pytest.mark.filterwarnings("ignore:Heightfield.from_heights")


@pytest.fixture
def small(monkeypatch):
    """Gaussian tiles of few texels."""
    monkeypatch.setattr(light, "SIZE", 128)


@pytest.mark.usefixtures("small")
def test_a_block_has_many_indices():
    """Each roughness one of its own, on either side of 1 and within the range; nearly all light leaves, much of it downward."""
    block = light.gaussian_glass_block((0.1, 1.0), 3, 0)
    again = light.gaussian_glass_block((0.1, 1.0), 3, 0)
    assert all(np.array_equal(x, again[name]) for name, x in block.items())
    eta = block["eta"].reshape(light.GLASS_BATCHES, -1)
    assert (eta == eta[:, :1]).all() and len(np.unique(eta[:, 0])) == light.GLASS_BATCHES
    ratio = np.maximum(eta, 1 / eta)
    assert ratio.min() > 1.06 and ratio.max() < 3.1 and 0.25 < (eta[:, 0] > 1).mean() < 0.75
    assert (block["order"] > 0).mean() > 0.999 and 0.3 < (block["wo"][:, 2] < 0).mean() < 0.8


@pytest.mark.parametrize("above", [True, False])
def test_integrals_are_those_of_smiths_walks(above, generator):
    """What the points say leaves after one bounce, and after all others, is what walks carry: to four standard errors."""
    n = 400
    ax, ay = (0.2 + 0.8 * torch.rand(n, generator=generator) for _ in range(2))
    eta = torch.where(torch.arange(n) % 2 == 0, 1.2, 1 / 1.7)
    wi = torch.nn.functional.normalize(torch.randn(n, 3, generator=generator), dim=-1)
    where = Surfaces(ax, ay, eta, wi * torch.where(wi[:, 2:] < 0, -1.0, 1.0))
    wo, smith = glass.points(where, above, None, 5)
    assert wo.shape == (n * fit.POINTS, 3) and ((wo[:, 2] > 0) == above).all()
    said = smith.reshape(n, fit.POINTS, ORDERS).sum(1)
    walks = RoughDielectric(Beckmann(ax, ay), Dielectric(eta), Distilled()).albedo(where.wi, Stream(2, 64, "sobol"))
    found = (walks.reflected if above else walks.transmitted)[..., 0]
    for mine, theirs in ((said[:, 0], found[:, 0]), (said[:, 1:].sum(1), found[:, 1])):
        gap = mine - theirs
        assert abs(float(gap.mean())) < 4 * float(gap.std()) / math.sqrt(n) + 1e-3


@pytest.mark.parametrize(("alpha", "eta"), [((0.25, 0.25), 1.5), ((1.0, 0.1), 1.5), ((0.1, 0.1), 1.3)], ids=str)
def test_narrow_lobes_have_their_energy(alpha, eta):
    """Straight down, where transmitted lobes are narrower than a cell: cells to 0.005, points near the lobe to 0.001."""
    cell, model = held_out.Cell(alpha[0], alpha[1], 0.0, 0.0), Distilled()
    surface = RoughDielectric(Beckmann(*alpha), Dielectric(eta), model, "importance")

    @torch.no_grad()
    def orders(cell: held_out.Cell, wo: torch.Tensor) -> torch.Tensor:
        return surface.orders(glass_report.incident(cell, wo), wo)[..., 0]

    walks = surface.albedo(torch.tensor([0.0, 0.0, 1.0]), Stream(1, 1 << 14, "sobol"))
    once = [float(leg[0, 0]) for leg in (walks.reflected, walks.transmitted)]
    cells = glass_report.shares(orders, [cell]).sum((-2, -1))[:, 0]
    near = [float(glass_report.energies(orders, cell, alpha, eta, above)[0]) for above in (True, False)]
    assert cells.tolist() == pytest.approx(once, abs=5e-3) and near == pytest.approx(once, abs=1e-3)


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_gaussian_glass_becomes_lobes(tmp_path: Path, capsys):
    """From a seed to a file, the same bits after a stop; it serves both sides, and indices in its range only."""
    options = command.Options(
        material="dielectric",
        blocks=2,
        steps=20,
        widths=(6, 5),
        each=(4,),
        threads=1,
        out=tmp_path / "glass.npz",
        work=tmp_path / "work",
    )
    command.main(options)
    model = Distilled(tmp_path / "glass.npz")
    for eta in (1.5, 1 / 1.5, 1.3, 3.0, 1 / 3):
        values = RoughDielectric(Beckmann(0.3, 0.9), Dielectric(eta), model)(*torch.eye(3)[[2, 2]])
        assert torch.isfinite(values).all() and (values > 0).all()
    for eta in (1.25, 0.8, 3.1):
        with pytest.raises(ValueError, match=r"must lie in \[1.3, 3\] or"):
            RoughDielectric(Beckmann(0.3, 0.9), Dielectric(eta), model)
    options.out = tmp_path / "again.npz"
    command.main(options)
    again = Distilled(tmp_path / "again.npz")
    for (name, a), (_, b) in zip(model.state_dict().items(), again.state_dict().items(), strict=True):
        assert torch.equal(a, b), name
    assert "bytes" in capsys.readouterr().out


def words_of_a_scan(tmp_path: Path) -> list[str]:
    """Words of the command, for a height map that is not its own mirror image."""
    h = Heightfield.gaussian(0.6, size=256, seed=7).heights
    np.save(tmp_path / "scan.npy", h + 0.3 * np.abs(h))
    words = ["distil", "--surface", str(tmp_path / "scan.npy"), "--spacing", "0.0625", "--height-scale", "1"]
    return [*words, "--periodic", "--out", str(tmp_path / "glass.npz")]


@pytest.mark.slow
def test_a_scan_of_glass_becomes_lobes(tmp_path: Path, capsys, monkeypatch):
    """From heights to a file: reciprocal, and energies are nearer to the light than those of Smith's theory."""
    monkeypatch.setattr(scan, "ANGLES", (0.0, 1.2))
    monkeypatch.setattr(scan, "AZIMUTHS", 2)
    words = [*words_of_a_scan(tmp_path), "--material", "dielectric", "--eta", "1.5", "--paths", "8e5", "--steps", "200"]
    words += ["--held-out", "6e4", "--work", str(tmp_path / "work"), "--json", str(tmp_path / "glass.json")]
    assert main(words) == 0
    assert "inside" in capsys.readouterr().out
    model = Distilled(tmp_path / "glass.npz")
    surface = RoughDielectric(model.slopes, Dielectric(1.5), model, "importance").double()
    wi, wo = torch.nn.functional.normalize(torch.randn(2, 50, 3, dtype=torch.float64), dim=-1)
    n2 = torch.where(wi[:, 2] > 0, 1.0, 1.5**2), torch.where(wo[:, 2] > 0, 1.0, 1.5**2)
    there, back = surface(wi, wo)[:, 0] / wo[:, 2].abs() * n2[0], surface(wo, wi)[:, 0] / wi[:, 2].abs() * n2[1]
    torch.testing.assert_close(there, back, rtol=1e-6, atol=1e-9)
    assert (there > 0).all()
    gaps = model.certificates["Tabulated scan_glass"]["rms of the largest energy gaps"]
    assert gaps["distilled"] < gaps["Smith, Beckmann"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--material", "dielectric"], "needs --eta"),
        (["--eta", "1.5"], "--eta is of --material dielectric; conductor has none"),
        (["--material", "diffuse", "--eta", "1.5"], "diffuse has none"),
        (["--material", "dielectric", "--eta", "1"], "differ from 1"),
        (["--material", "dielectric", "--eta", "1.01"], "got 1.01"),
        (["--material", "dielectric", "--eta", "3.5"], "must lie in [1/3, 3]"),
        (["--material", "dielectric", "--eta", "0.3"], "must lie in [1/3, 3]"),
        (["--material", "dielectric", "--eta", "-1.5"], "got -1.5"),
        (["--material", "dielectric", "--eta", "nan"], "got nan"),
    ],
    ids=lambda x: " ".join(x) if isinstance(x, list) else "",
)
def test_indices_that_do_not_fit(words, says, tmp_path: Path, capsys):
    """Refused in a line that says what would do, before anything is traced."""
    assert main([*words_of_a_scan(tmp_path), *words]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "glass.npz").exists()
