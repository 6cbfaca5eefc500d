"""Every source that the code names is in the table, and every one of the table in docs/references.md."""

import re
from pathlib import Path
from typing import ClassVar

import pytest
from cases import DISTRIBUTIONS, EVERY_SCATTERING, MATERIALS, SEGMENTS

import torchms as ms
from torchms.citations import PAPERS
from torchms.fresnel import Conductor, Dielectric

ROOT = Path(__file__).parent.parent
KEY = re.compile(r"\[([A-Z][A-Za-z]*\d{4})[\],]")


def test_the_code_names_no_other_source() -> None:
    named = {key for file in (ROOT / "torchms").rglob("*.py") for key in KEY.findall(file.read_text())}
    assert named, "the pattern finds nothing"
    assert named <= set(PAPERS), named - set(PAPERS)


def test_the_readme_lists_them_all() -> None:
    sources = (ROOT / "docs" / "references.md").read_text().split("## Sources")[1]
    listed = dict(re.findall(r"^- \[(\w+\d{4})\] (.+)$", sources, re.M))
    assert set(listed) == set(PAPERS)
    for key, paper in PAPERS.items():
        assert paper.title in listed[key], key


def test_every_public_part_has_its_papers() -> None:
    objects = [make(0.5) for make in DISTRIBUTIONS.values()]
    objects += [make(3) for make in EVERY_SCATTERING.values()] + [make() for make in SEGMENTS.values()]
    objects += [MATERIALS[name](ms.GGX(0.5), ms.SingleBounce()) for name in MATERIALS]
    for part in objects:
        assert ms.cite(part) or type(part) is ms.SingleBounce, part


def test_the_parts_of_a_bsdf() -> None:
    gold = ms.RoughConductor(ms.GGX(0.5), Conductor.metal("Au"), ms.Bidirectional(ms.Invariance(), 4))
    keys = re.findall(r"^\[(\w+)\]", ms.cite(gold), re.M)
    assert keys == ["Walter2007", "Heitz2014", "Wang2022", "Cui2023", "Dupuy2023", "Tokuyoshi2023"]
    glass = ms.RoughDielectric(ms.Beckmann(0.5), Dielectric(1.5), ms.HeightWalk())
    assert re.findall(r"^@misc\{(\w+),", ms.cite(glass, "bibtex"), re.M) == ["Walter2007", "Heitz2014", "Heitz2016"]
    assert ms.cite(glass, "bibtex").count("{") == ms.cite(glass, "bibtex").count("}")


def test_a_constrained_part_is_known() -> None:
    distribution = ms.GGX(0.5)
    before = ms.cite(distribution)
    assert before and ms.cite(ms.constrain(distribution, "alpha")) == before


def test_what_is_cited_exists() -> None:
    """Every source that a class names is in the table; one that is not there is said to be missing."""
    text = "".join(file.read_text() for file in (ROOT / "torchms").rglob("*.py"))
    named = {
        key for line in re.findall(r"^    sources = \((.*)\)$", text, re.M) for key in re.findall(r'"(\w+)"', line)
    }
    assert len(named) > 8 and named <= set(PAPERS)

    class Mine(ms.GGX):
        sources: ClassVar[tuple[str, ...]] = ("Nobody1900",)

    with pytest.raises(ValueError, match=r"Nobody1900.*PAPERS"):
        ms.cite(Mine(0.5))
    Mine.sources = ("Hill2018",)
    assert re.findall(r"^\[(\w+)\]", ms.cite(Mine(0.5)), re.M) == ["Walter2007", "Hill2018", "Dupuy2023"]


def test_the_citation_file_is_of_this_version() -> None:
    lines = (ROOT / "CITATION.cff").read_text().splitlines()
    assert lines[0] == "cff-version: 1.2.0" and f"version: {ms.__version__}" in lines
    for required in ("message: ", "title: ", "authors:"):
        assert any(line.startswith(required) for line in lines), required


@pytest.mark.usefixtures("messages")
def test_bad_arguments() -> None:
    with pytest.raises(TypeError, match=r"GGX.*got str"):
        ms.cite("GGX")
    with pytest.raises(ValueError, match=r'"bibtex"; got \'html\''):
        ms.cite(ms.GGX(0.5), "html")


def test_a_file_cites_what_its_surface_does() -> None:
    """The metadata of an ONNX file has the papers of `cite`, for every scattering and material."""
    onnx = pytest.importorskip("onnx", reason="needs the onnx extra: pip install torchms[onnx]")
    from torchms.onnx.exporter import checked
    from torchms.onnx.metadata import describe

    for name, make in EVERY_SCATTERING.items():
        kind = ms.Beckmann if name == "distilled-gaussian" else ms.GGX
        surface = ms.RoughConductor(kind(0.5), Conductor.metal("Au"), make(2))
        model = onnx.ModelProto()
        describe(model, checked(surface, "forward", (), "input", 1))
        said = {entry.key: entry.value for entry in model.metadata_props}
        assert said["torchms.citation"] == ms.cite(surface)


@pytest.mark.parametrize("scattering", [ms.SingleBounce, ms.KullaConty, ms.Turquin])
def test_one_bounce_is_not_after_the_papers_on_several(scattering: type) -> None:
    """A single bounce holds a segment, but for one bounce that is the G2 of 2014."""
    assert not {"Wang2022", "Cui2023"} & set(re.findall(r"^\[(\w+)\]", ms.cite(scattering()), re.M))
    assert "[Heitz2014]" in ms.cite(ms.SingleBounce())
