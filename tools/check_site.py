"""Checks a built documentation: `python -m tools.check_site build/docs`, or `make docs-check`.

First without a browser: every link inside the site leads to a file and to an anchor of it, every picture is there and is a
picture, and says what it shows. Then, where there is a Chromium, in it: every page loads without a missing file or an error,
every picture is drawn, and the search finds words on the pages that they are on. Exits with 1 and the list of what is wrong.
"""

import argparse
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urldefrag, urlsplit

from tools.site_browser import browse, find_chromium

ELSEWHERE = ("http", "https", "mailto", "data", "javascript")
"""Addresses that are not part of the site; nothing is fetched."""


THUMBNAIL = "_thumb.png"
"""Pictures of the gallery's index, whose titles stand beside them."""


class Page(NamedTuple):
    """What a page points at, its anchors, and its pictures with their descriptions."""

    links: list[str]
    anchors: set[str]
    pictures: list[tuple[str, str]]


class Reader(HTMLParser):
    """Collects a `Page`."""

    def __init__(self) -> None:
        super().__init__()
        self.page = Page([], set(), [])

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        for name in ("id", "name"):
            if name in given and tag != "meta":
                self.page.anchors.add(given[name])
        if tag in ("a", "link") and "href" in given:
            self.page.links.append(given["href"])
        if tag in ("script", "img", "source", "iframe") and "src" in given:
            self.page.links.append(given["src"])
        if tag == "img":
            self.page.pictures.append((given.get("src", ""), given.get("alt", "")))


def read(path: Path) -> Page:
    """The page in a file."""
    reader = Reader()
    reader.feed(path.read_text())
    return reader.page


def faults(folder: Path) -> list[str]:
    """What is wrong with links and pictures of the pages in `folder`, found without a browser."""
    pages = {path.resolve(): read(path) for path in sorted(folder.rglob("*.html")) if not is_lab(folder, path)}
    if not pages:
        return [f"{folder}: there are no pages; make docs builds them."]
    found = []
    for path, page in pages.items():
        name = path.relative_to(folder.resolve()).as_posix()
        for link in page.links:
            wrong = broken(path, link, pages)
            if wrong:
                found.append(f"{name}: {link}: {wrong}")
        for source, description in page.pictures:
            if not (description.strip() or source.endswith(THUMBNAIL)):
                found.append(f"{name}: {source}: the picture does not say what it shows (alt)")
    return found + [f"{path.name}: {wrong}" for path in pictures_of(folder) if (wrong := unreadable(path))]


def is_lab(folder: Path, path: Path) -> bool:
    """Whether the file belongs to the lobe lab, which has tests of its own."""
    return path.is_relative_to(folder / "lab")


def broken(path: Path, link: str, pages: dict[Path, Page]) -> str:
    """Why `link` on the page at `path` leads nowhere, or nothing."""
    address, anchor = urldefrag(link)
    if urlsplit(link).scheme in ELSEWHERE:
        return ""
    target = path if not address else (path.parent / unquote(urlsplit(address).path)).resolve()
    if target.is_dir():
        target = target / "index.html"
    if not target.is_file():
        return "there is no such file"
    if anchor and target in pages and unquote(anchor) not in pages[target].anchors:
        return f"the page has no anchor {anchor!r}"
    return ""


def pictures_of(folder: Path) -> list[Path]:
    """The pictures of the site's own pages."""
    return [path for path in sorted(folder.rglob("*.png")) if not is_lab(folder, path)]


def unreadable(path: Path) -> str:
    """Why a file is no picture, or nothing."""
    content = path.read_bytes()
    whole = content.startswith(b"\x89PNG\r\n\x1a\n") and content.rstrip(b"\0").endswith(b"IEND\xaeB`\x82")
    return "" if whole else "is not a whole PNG"


SEARCHES = {
    "masking": "theory/facets.html",
    "Distilled": "api/scattering.html",
    "checkpoint": "howto/checkpoints.html",
    "glTF": "howto/gltf.html",
}
"""Words, and a page that a search for them must name."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("build/docs"))
    parser.add_argument("--no-browser", action="store_true", help="check files only")
    options = parser.parse_args()
    found = faults(options.folder)
    pages = sorted(p.relative_to(options.folder).as_posix() for p in options.folder.rglob("*.html"))
    chromium = None if options.no_browser else find_chromium()
    if chromium is not None and not found:
        found += browse(options.folder, [p for p in pages if p != "search.html"], SEARCHES, chromium)
    print("\n".join(found) or f"{len(pages)} pages: no broken link, no missing picture", end="")
    print("; not tried in a browser." if chromium is None else "." if found else "; search works.")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
