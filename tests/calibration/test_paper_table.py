"""The table of the paper in the package's docstring names things that exist."""

import pkgutil
import re

import pytest

import analysis

NAMES = re.findall(r"`(analysis\.[\w.]+)`", analysis.__doc__)


def test_the_table_is_there():
    assert len(NAMES) >= 14


@pytest.mark.parametrize("name", NAMES)
def test_every_entry_exists_and_is_documented(name):
    assert pkgutil.resolve_name(name).__doc__
