"""The papers behind the parts of a BSDF: `torchms.cite`."""

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
"""Every source by its key; the README lists them under Sources. (A key's year is that of the first copy we had.)"""

BEHIND: dict[str, tuple[str, ...]] = {
    "GGX": ("Walter2007", "Dupuy2023"),
    "Beckmann": ("Walter2007",),
    "GTR": ("Burley2012", "Dimov2015"),
    "RoughConductor": ("Heitz2014",),
    "RoughDielectric": ("Heitz2014", "Walter2007"),
    "RoughDiffuse": ("Heitz2014", "HeitzDupuy2015"),
    "Unidirectional": ("Wang2022",),
    "Bidirectional": ("Wang2022",),
    "Uncorrelated": ("Wang2022",),
    "Correlated": ("Wang2022",),
    "Invariance": ("Cui2023",),
    "HeightWalk": ("Heitz2016",),
    "KullaConty": ("KullaConty2017", "Hill2018"),
    "Turquin": ("Turquin2019",),
    "Distilled": ("Wang2022", "Cui2023"),
}
"""What a class, by its name, is made after; a class of which nothing is said here adds nothing."""

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
    names = {base.__name__ for part in bsdf.modules() for base in type(part).__mro__}
    keys = {key for name in names for key in BEHIND.get(name, ())}
    return keys | {key for pair, key in TOGETHER.items() if names.issuperset(pair)}


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
