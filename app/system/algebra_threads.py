"""Linear algebra on one thread: the arrays here are small, and threads of their own would only take
the processors from the correlation.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

VARIABLE = "OPENBLAS_NUM_THREADS"  # OpenBLAS reads it as it is loaded


@contextmanager
def one_algebra_thread() -> Iterator[None]:
    """Within it, and in processes that start from it, linear algebra uses one thread, whoever has
    loaded its library.
    """
    from threadpoolctl import threadpool_limits

    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = "1"
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before
