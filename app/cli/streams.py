"""Standard output and standard error to which one can always write: that nobody reads them any
more, or that a name cannot be printed, ends no experiment.
"""

from __future__ import annotations

import errno
import io
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

CLOSED = (errno.EPIPE, errno.EINVAL)  # errors of a stream that its reader closed; EINVAL on Windows


class _Steady(io.RawIOBase):
    """Writes to another stream until that fails, then drops what is written.

    Attributes
    ----------
    failure : OSError or None
    """

    def __init__(self, raw: Any) -> None:
        self.failure: OSError | None = None
        self._raw = raw

    def write(self, data: Any, /) -> int:
        """Write all or a part; how many bytes."""
        while self.failure is None:
            try:
                written: int | None = self._raw.write(data)
            except OSError as error:
                self.failure = error
            else:
                if written is not None:
                    return written
                time.sleep(0.01)  # it does not wait, and is full
        return len(data)

    def writable(self) -> bool:
        """True."""
        return True

    def isatty(self) -> bool:
        """Whether the other one is a terminal."""
        return bool(self._raw.isatty())

    def fileno(self) -> int:
        """That of the other one."""
        return int(self._raw.fileno())


@contextmanager
def steady_streams() -> Iterator[None]:
    """Make them so while the block lasts; characters that they have not are written as escapes.

    What could not be written for another reason than that nobody reads it (a full disk) is told,
    and a block that would end the program with 0 ends it with 1.
    """
    steady = {name: stream for name in ("stdout", "stderr") if (stream := _made_steady(name))}
    code: Any = 0
    try:
        yield
    except SystemExit as error:
        code = error.code
        raise
    finally:
        for name in steady:
            getattr(sys, name).flush()
        failure = steady["stdout"].failure if "stdout" in steady else None
        if failure is not None and failure.errno not in CLOSED and not code:
            print(
                f"slipscope: what was done could not be written to standard output ({failure}); it"
                " is incomplete",
                file=sys.stderr,
            )
            raise SystemExit(1)


def _made_steady(name: str) -> _Steady | None:
    stream = getattr(sys, name)
    if not isinstance(stream, io.TextIOWrapper):
        return None  # closed before the program began, or somebody's own
    stream.flush()
    steady = _Steady(getattr(stream.buffer, "raw", stream.buffer))
    buffered = io.BufferedWriter(steady)
    lines = stream.line_buffering or name == "stderr"
    wrapped = io.TextIOWrapper(buffered, stream.encoding, "backslashreplace", line_buffering=lines)
    setattr(sys, name, wrapped)
    return steady
