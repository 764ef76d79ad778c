"""Linear algebra on one thread, also in the process of a script that has loaded numpy before."""

import os

import numpy as np
import pytest
from python_program import python
from threadpoolctl import threadpool_info, threadpool_limits

import slipscope
from app.runs import live
from app.system.algebra_threads import VARIABLE, one_algebra_thread


def threads() -> set[int]:
    assert np.linalg.det(np.eye(2)) == 1
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="with one processor there is one thread")
@pytest.mark.parametrize("given", [None, "2"])
def test_a_script_has_its_threads_again_afterwards(
    monkeypatch: pytest.MonkeyPatch, given: str | None
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    if given:
        monkeypatch.setenv(VARIABLE, given)
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with one_algebra_thread():
            assert threads() == {1}
            code = f"import os; print(os.environ[{VARIABLE!r}])"  # a process that starts meanwhile
            assert python("-c", code, code=0).stdout.split() == ["1"]
        assert threads() == before != {1}
    assert os.environ.get(VARIABLE) == given


def test_a_run_from_python_uses_one_thread(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    seen = []

    def none_is_made(*_: object, **__: object) -> None:
        seen.append(threads())
        raise slipscope.UserError("no run")

    monkeypatch.setattr(live, "make_run", none_is_made)
    with (
        threadpool_limits(2, user_api="blas"),
        pytest.raises(slipscope.UserError, match="no run"),
    ):
        slipscope.run(tmp_path / "r.h5")
    assert seen == [{1}]
