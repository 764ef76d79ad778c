"""The page of the file of results is made from its layout."""

from pathlib import Path

from app.session.results_layout import RESULTS_VERSION
from docs import reference

PAGE = Path(__file__).parents[2] / "docs" / "results.md"


def test_the_page_has_every_dataset():
    text = PAGE.read_text(encoding="utf-8")
    assert text.endswith(f"## Every dataset\n\n{reference.results_datasets()}")
    assert f"version {RESULTS_VERSION};" in text
