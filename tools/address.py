"""Says where the repository is hosted, once, before a release: python -m tools.address https://host/owner/torchms

A package index shows the README without the files beside it, so its links and pictures become addresses, those of the tag of
this version; setup.cfg gets the project's URLs, CITATION.cff the repository. Run it again after the version has changed.
"""

import re
import sys
from pathlib import Path

from torchms.version import __version__

ROOT = Path(__file__).parent.parent
LINK = re.compile(r'(\]\(|src=")([^)"\s]+)')


def addressed(readme: str, url: str, tag: str) -> str:
    """The README with every link to a file of the repository as an address of `tag`; pictures as the file itself."""

    def link(found: re.Match[str]) -> str:
        path = re.sub(rf"^{re.escape(url)}/(blob|raw)/[^/]+/", "", found[2])
        if path.startswith(("http", "#")):
            return found[0]
        kind = "raw" if path.endswith(".png") else "blob"
        return f"{found[1]}{url}/{kind}/{tag}/{path}"

    return LINK.sub(link, readme)


def with_urls(setup: str, url: str, tag: str) -> str:
    """setup.cfg with its project_urls."""
    setup = re.sub(r"^# `python -m tools\.address.*\n|^project_urls =\n(?:    .*\n)+", "", setup, flags=re.M)
    lines = (
        f"Source = {url}",
        f"Documentation = {url}/tree/{tag}/docs",
        f"Changelog = {url}/blob/{tag}/CHANGELOG.md",
        f"Issues = {url}/issues",
    )
    urls = "project_urls =\n" + "".join(f"    {line}\n" for line in lines)
    return setup.replace("classifiers =\n", f"{urls}classifiers =\n", 1)


def with_repository(citation: str, url: str) -> str:
    """CITATION.cff with the address of the code."""
    citation = re.sub(r"^repository-code: .*\n", "", citation, flags=re.M)
    return citation.replace("authors:\n", f'repository-code: "{url}"\nauthors:\n', 1)


def write(root: Path, url: str) -> None:
    """Change the three files below `root`. Raises ValueError for an address that is none."""
    url = url.rstrip("/")
    if not re.fullmatch(r"https://[\w.-]+/[\w./-]+", url):
        raise ValueError(f"the address must be https://host/owner/name; got {url!r}.")
    tag = f"v{__version__}"
    for name, changed in (
        ("README.md", lambda text: addressed(text, url, tag)),
        ("setup.cfg", lambda text: with_urls(text, url, tag)),
        ("CITATION.cff", lambda text: with_repository(text, url)),
    ):
        path = root / name
        path.write_text(changed(path.read_text()))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    write(ROOT, sys.argv[1])
