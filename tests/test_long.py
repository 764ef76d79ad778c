"""Each measured promise holds: `pytest -m long -n 0 [-k NAME]`, on a computer that does nothing
else. The figures are printed (`-s`) and not kept; `python -m benchmarks.measurements --run NAME`
keeps them.
"""

import shlex

import pytest

from benchmarks.__main__ import measured
from benchmarks.measurements import collected

PROMISES = {
    name: shlex.split(result.command)[3:]
    for name, result in collected().items()
    if any(figure.at_most is not None for figure in result.figures)
}


@pytest.mark.long
@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", PROMISES)
def test_a_promise_holds(name):
    results, code = measured(PROMISES[name])
    missed = [f"{one.name} {one.column}: {one.text()}" for one in results.figures if one.is_missed]
    assert not missed
    assert code == 0
