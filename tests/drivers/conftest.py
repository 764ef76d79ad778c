"""Benches of a Newport driver on an emulated controller."""

import pytest
from newport_bench import benches

newport = pytest.fixture(benches)


@pytest.fixture
def newport_open(newport):
    return lambda *args, **kwargs: newport(*args, **kwargs).opened()
