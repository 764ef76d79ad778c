"""Functions that numba compiles, kept for the next start: where that can not be done, or what was
kept is damaged, they are compiled anew and a warning says so.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
import warnings
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core import caching, serialize


class KernelWarning(UserWarning):
    """A start takes longer than it should, by the time of compiling."""


def _warn(sentence: str) -> None:
    if sentence not in told:
        told.append(sentence)
        warnings.warn(sentence, KernelWarning, stacklevel=2)


told: list[str] = []
"""What was warned of in this process, a sentence each."""


def _private_folder() -> str:
    """A folder for temporary files that nobody else can write to: what is kept is executed."""
    user = os.getuid() if hasattr(os, "getuid") else ""
    folder = os.path.join(tempfile.gettempdir(), f"slipscope-kernels-{user}")
    os.makedirs(folder, 0o700, exist_ok=True)
    held = os.lstat(folder)
    if hasattr(os, "getuid") and (held.st_uid != user or held.st_mode & 0o077):
        raise PermissionError(f"{folder} is not this user's alone")
    return folder


class _TemporaryLocator(caching.UserProvidedCacheLocator):  # type: ignore[misc]
    """The last resort, where neither the program's folder nor that of the user can be written."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)
        place = self.get_suitable_cache_subpath(py_file)
        self._cache_path = os.path.join(_private_folder(), place)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _TemporaryLocator | None:
        """The locator; None if there is no such folder."""
        try:
            locator = cls(py_func, py_file)
            locator.ensure_cache_path()
        except OSError:
            return None
        _warn(
            "compiled code can be kept neither beside the program nor in the user's folder; it is"
            f" kept in {os.path.dirname(locator.get_cache_path())} for now: set NUMBA_CACHE_DIR to"
            " a folder that can be written"
        )
        return locator


class _Checked(caching.CompileResultCacheImpl):  # type: ignore[misc]
    """What is kept has a checksum: the machine code of a torn file would be executed."""

    _locator_classes = (*caching.CompileResultCacheImpl._locator_classes, _TemporaryLocator)

    def reduce(self, cres: Any) -> tuple[bytes, bytes]:
        """Checksum and content of a compiled function."""
        content = serialize.dumps(super().reduce(cres))
        return hashlib.sha256(content).digest(), content

    def rebuild(self, target_context: Any, payload: tuple[bytes, bytes]) -> Any:
        """The function; ValueError if its content is not what was kept."""
        digest, content = payload
        if hashlib.sha256(content).digest() != digest:
            raise ValueError("its checksum is wrong")
        return super().rebuild(target_context, pickle.loads(content))


class _Kept(caching.FunctionCache):  # type: ignore[misc]
    """Keeps a function, and does without what can not be read or written."""

    _impl_class = _Checked

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The function that was kept for these arguments, or None."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever comes of damaged bytes
            _warn(f"compiled code that was kept in {self.cache_path} is damaged; it is made anew")
            self._attempt(self.flush)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a function."""
        self._attempt(super().save_overload, sig, data)

    def _attempt(self, step: Callable[..., None], *arguments: Any) -> None:
        try:
            step(*arguments)
        except Exception as error:
            self.disable()
            reason = getattr(error, "strerror", None) or error
            _warn(
                f"compiled code can not be kept in {self.cache_path} ({reason}); the next start"
                " compiles again: make room, or set NUMBA_CACHE_DIR to a folder that can be written"
            )


def compiled(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Compile a function when it is first called, without the lock of the interpreter, and keep it;
    a decorator, with the options of `numba.njit`.
    """
    if function is None:
        return lambda given: compiled(given, **options)
    made = njit(nogil=True, **options)(function)
    try:
        made._cache = _Kept(function)
    except RuntimeError:  # numba knows no place for it
        _warn(
            "compiled code can be kept nowhere, every start compiles; set NUMBA_CACHE_DIR to a"
            " folder that can be written"
        )
    return made


def is_kept(function: Any) -> bool:
    """Whether a compiled function is kept as its source is now, for some type of its arguments."""
    try:
        return bool(function._cache._cache_file._load_index())
    except Exception:  # nothing is kept, or what is kept is damaged
        return False


def place() -> str:
    """The folder in which compiled functions such as those of this module are kept; or nothing."""
    try:
        return str(_Kept(place).cache_path)
    except RuntimeError:
        return ""
