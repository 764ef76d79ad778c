"""Where the pages of the manual are: beside the sources, or where a wheel has put them."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

PAGES = "share/doc/slipscope/docs"  # in the data of a wheel, as pyproject.toml says
FIRST_PAGE = "window.md"


def manual_folder(sources: Path = Path(__file__).parents[2]) -> Path:
    """The folder of the pages; where there are none, the one where they would be in `sources`."""
    beside = sources / "docs"
    if (beside / FIRST_PAGE).is_file():
        return beside
    try:
        installed = metadata.files("slipscope") or ()
    except metadata.PackageNotFoundError:
        installed = ()
    for file in installed:
        if file.as_posix().endswith(f"{PAGES}/{FIRST_PAGE}"):
            return Path(str(file.locate())).resolve().parent
    return beside
