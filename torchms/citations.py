"""The papers behind the parts of a BSDF: `torchms.cite`. A class names its own by their keys, as `sources`."""

from collections.abc import Iterator
from typing import Literal, NamedTuple

from torch import nn


class Paper(NamedTuple):
    """One source; `where` is the journal, the proceedings or the publisher."""

    authors: tuple[str, ...]
    title: str
    where: str
    year: int


PAPERS: dict[str, Paper] = {
    "Burley2012": Paper(
        ("Brent Burley",), "Physically Based Shading at Disney", "SIGGRAPH course Physically Based Shading", 2012
    ),
    "Cui2023": Paper(
        ("Yuang Cui", "Gaole Pan", "Jian Yang", "Lei Zhang", "Ling-Qi Yan", "Beibei Wang"),
        "Multiple-bounce Smith Microfacet BRDFs using the Invariance Principle",
        "SIGGRAPH Asia Conference Papers",
        2023,
    ),
    "Dimov2015": Paper(
        ("Rossen Dimov",),
        "Deriving the Smith shadowing function G1 for γ ∈ (0, 4]",
        "Chaos Group, technical report",
        2015,
    ),
    "Dupuy2023": Paper(
        ("Jonathan Dupuy", "Anis Benyoub"),
        "Sampling Visible GGX Normals with Spherical Caps",
        "Computer Graphics Forum 42(8)",
        2023,
    ),
    "DupuyJakob2018": Paper(
        ("Jonathan Dupuy", "Wenzel Jakob"),
        "An Adaptive Parameterization for Efficient Material Acquisition and Rendering",
        "ACM Transactions on Graphics 37(6)",
        2018,
    ),
    "Heitz2014": Paper(
        ("Eric Heitz",),
        "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs",
        "Journal of Computer Graphics Techniques 3(2)",
        2014,
    ),
    "Heitz2016": Paper(
        ("Eric Heitz", "Johannes Hanika", "Eugene d'Eon", "Carsten Dachsbacher"),
        "Multiple-Scattering Microfacet BSDFs with the Smith Model",
        "ACM Transactions on Graphics 35(4)",
        2016,
    ),
    "HeitzDupuy2015": Paper(
        ("Eric Heitz", "Jonathan Dupuy"),
        "Implementing a Simple Anisotropic Rough Diffuse Material with Stochastic Evaluation",
        "technical report",
        2015,
    ),
    "Hill2018": Paper(("Stephen Hill",), "A Multi-Faceted Exploration", "Self Shadow", 2018),
    "KullaConty2017": Paper(
        ("Christopher Kulla", "Alejandro Conty"),
        "Revisiting Physically Based Shading at Imageworks",
        "SIGGRAPH course Physically Based Shading",
        2017,
    ),
    "Salmon2011": Paper(
        ("John K. Salmon", "Mark A. Moraes", "Ron O. Dror", "David E. Shaw"),
        "Parallel Random Numbers: As Easy as 1, 2, 3",
        "Supercomputing (SC)",
        2011,
    ),
    "Tokuyoshi2023": Paper(
        ("Yusuke Tokuyoshi", "Kenta Eto"),
        "Bounded VNDF Sampling for the Smith–GGX BRDF",
        "Proceedings of the ACM on Computer Graphics and Interactive Techniques 7(1)",
        2024,
    ),
    "Turquin2019": Paper(
        ("Emmanuel Turquin",),
        "Practical Multiple Scattering Compensation for Microfacet Models",
        "Industrial Light & Magic, technical report",
        2019,
    ),
    "Walter2007": Paper(
        ("Bruce Walter", "Stephen R. Marschner", "Hongsong Li", "Kenneth E. Torrance"),
        "Microfacet Models for Refraction through Rough Surfaces",
        "Eurographics Symposium on Rendering",
        2007,
    ),
    "Wang2022": Paper(
        ("Beibei Wang", "Wenhua Jin", "Jiahui Fan", "Jian Yang", "Nicolas Holzschuch", "Ling-Qi Yan"),
        "Position-free Multiple-bounce Computations for Smith Microfacet BSDFs",
        "ACM Transactions on Graphics 41(4)",
        2022,
    ),
}
"""Every source by its key; docs/references.md lists them. (A key's year is that of the first copy we had.)"""

TOGETHER: dict[tuple[str, str], str] = {("RoughConductor", "GGX"): "Tokuyoshi2023"}
"""What two classes of one BSDF are made after: a conductor samples GGX by bounded visible normals."""


def cite(bsdf: nn.Module, style: Literal["text", "bibtex"] = "text") -> str:
    """The papers behind `bsdf`, or a part of one, oldest first: a line each, or BibTeX entries.

    Raises TypeError if it is not a module, ValueError for another style.
    """
    if not isinstance(bsdf, nn.Module):
        raise TypeError(f"cite(bsdf) takes a BSDF or a part of one, such as GGX(0.5); got {type(bsdf).__name__}.")
    if style not in ("text", "bibtex"):
        raise ValueError(f'cite(style=...) must be "text" or "bibtex"; got {style!r}.')
    keys = sorted(_keys(bsdf), key=lambda key: (PAPERS[key].year, key))
    written = [_bibtex(key, PAPERS[key]) if style == "bibtex" else _text(key, PAPERS[key]) for key in keys]
    return "\n".join(written)


def _keys(bsdf: nn.Module) -> set[str]:
    # A parametrized module (see `constrain`) is of a class of its own, whose base is meant.
    bases = {base for part in _parts(bsdf) for base in type(part).__mro__}
    keys = {key for base in bases for key in vars(base).get("sources", ())}
    unknown = keys - set(PAPERS)
    if unknown:
        raise ValueError(
            f"sources of a part name {', '.join(sorted(unknown))}, which torchms.citations.PAPERS does not have. Add it there."
        )
    names = {base.__name__ for base in bases}
    return keys | {key for pair, key in TOGETHER.items() if names.issuperset(pair)}


def _parts(module: nn.Module) -> Iterator[nn.Module]:
    """`module` and its parts; not what a single bounce holds, for which all models of several bounces agree."""
    yield module
    if not any(base.__name__ == "SingleBounce" for base in type(module).__mro__):
        for child in module.children():
            yield from _parts(child)


def _text(key: str, paper: Paper) -> str:
    return f"[{key}] {', '.join(paper.authors)}: {paper.title}. {paper.where}, {paper.year}."


def _bibtex(key: str, paper: Paper) -> str:
    fields = {
        "author": " and ".join(paper.authors),
        "title": f"{{{paper.title}}}",
        "howpublished": paper.where.replace("&", r"\&"),
        "year": str(paper.year),
    }
    return "\n".join([f"@misc{{{key},", *(f"  {name} = {{{value}}}," for name, value in fields.items()), "}"])
