"""The table of the paper in docs/analysis.md names things that exist."""

import pkgutil
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "analysis.md"
NAMES = re.findall(r"^\|[^|]*\| `(analysis\.[\w.]+)` \|", PAGE.read_text("utf-8"), re.MULTILINE)


def test_the_table_is_there():
    assert len(NAMES) >= 14


@pytest.mark.parametrize("name", NAMES)
def test_every_entry_exists_and_is_documented(name):
    assert pkgutil.resolve_name(name).__doc__
