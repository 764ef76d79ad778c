"""Functions that numba compiles, kept for the next start.

numba keeps each function by its own source file, but what it keeps holds code of other functions,
of other files, too. So the folder is named by all files that define such functions, or that these
import: where one of them differs, all are compiled anew. Copies of the same files, wherever they
are, share what is kept. Where nothing can be kept, or what was kept is damaged, they are compiled
anew and a warning says so.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import shutil
import tempfile
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any

import numba
import numpy as np
import platformdirs
from numba import njit
from numba.core import caching, serialize

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PACKAGES = ("analysis", "drivers")  # in ROOT, which define compiled functions
DEFINES = b"kernels import compiled"  # stands in each file that does
IMPORTS = re.compile(rb"^from ([\w.]+) import", re.MULTILINE)
UNUSED_S = 7 * 86400.0  # after its last start: the folder of other sources, which may still run


class KernelWarning(UserWarning):
    """A start takes longer than it should, by the time of compiling."""


def _warn(sentence: str) -> None:
    if sentence not in cache_warnings:
        cache_warnings.append(sentence)
        warnings.warn(sentence, KernelWarning, stacklevel=2)


def _warn_of(folder: str, reason: object) -> None:
    _warn(
        f"compiled code cannot be kept in {folder} ({reason}); the next start compiles again: make"
        " room, or set NUMBA_CACHE_DIR to a folder that can be written"
    )


cache_warnings: list[str] = []
"""What was warned of in this process, a sentence each."""


def sources() -> list[str]:
    """The files that define compiled functions, and those that they import: a constant is part of
    the code.
    """
    contents = {}
    for package in PACKAGES:
        for folder, _, names in os.walk(os.path.join(ROOT, package)):
            for path in (os.path.join(folder, name) for name in names if name.endswith(".py")):
                with open(path, "rb") as file:
                    contents[path] = file.read()
    found: set[str] = set()
    new = {path for path, content in contents.items() if DEFINES in content}
    while new:
        found |= new
        modules = {module.decode() for path in new for module in IMPORTS.findall(contents[path])}
        paths = {os.path.join(ROOT, *module.split(".")) + ".py" for module in modules}
        new = (paths & contents.keys()) - found
    return sorted(found)


@cache
def version() -> str:
    """What all compiled functions depend on, as a name."""
    digest = hashlib.sha256(f"{numba.__version__} {np.__version__}".encode())
    for path in sources():
        with open(path, "rb") as file:
            content = hashlib.sha256(file.read()).digest()
        digest.update(os.path.relpath(path, ROOT).encode() + content)
    return digest.hexdigest()[:16]


@cache
def _own(folder: str) -> str:
    """The folder of this version in a folder, which is this user's alone: what is kept there is
    executed. Those of other versions that were not used for a while are removed.

    Raises
    ------
    OSError
        It cannot be written, or is open to others.
    """
    os.makedirs(folder, 0o700, exist_ok=True)
    held = os.lstat(folder)
    if hasattr(os, "getuid") and (held.st_uid != os.getuid() or held.st_mode & 0o022):
        raise PermissionError(f"{folder} is not this user's alone")
    own = os.path.join(folder, version())
    os.makedirs(own, 0o700, exist_ok=True)
    tempfile.TemporaryFile(dir=own).close()
    os.utime(own)
    for other in (entry for entry in os.scandir(folder) if entry.path != own):
        with suppress(OSError):  # another program removes it, too
            if time.time() - other.stat(follow_symlinks=False).st_mtime > UNUSED_S:
                shutil.rmtree(other.path, ignore_errors=True)
    return own


def place() -> str:
    """The folder in which compiled functions are kept; or nothing."""
    user = os.getuid() if hasattr(os, "getuid") else "user"
    if numba.config.CACHE_DIR:  # NUMBA_CACHE_DIR
        with suppress(OSError):
            return _own(os.path.join(numba.config.CACHE_DIR, f"slipscope-{user}"))
    with suppress(OSError):
        return _own(os.path.join(platformdirs.user_cache_dir("slipscope", False), "kernels"))
    try:
        own = _own(os.path.join(tempfile.gettempdir(), f"slipscope-kernels-{user}"))
    except OSError:
        _warn(
            "compiled code can be kept nowhere, every start compiles; set NUMBA_CACHE_DIR to a"
            " folder that can be written"
        )
        return ""
    _warn(
        "compiled code cannot be kept in the user's folder; it is kept in"
        f" {own} for now: set NUMBA_CACHE_DIR to a folder that can be written"
    )
    return own


class _Locator(caching._SourceFileBackedLocatorMixin, caching._CacheLocator):  # type: ignore[misc]
    """The place of a function: by its source's name in this copy of the program, and content."""

    def __init__(self, function: Callable[..., Any], path: str) -> None:
        self._py_file = path  # numba looks for these two
        self._lineno = function.__code__.co_firstlineno
        root, real = os.path.join(os.path.realpath(ROOT), ""), os.path.realpath(path)
        if real.startswith(root):
            folder = os.path.dirname(real.removeprefix(root)).replace(os.sep, ".")
        else:
            folder = self.get_suitable_cache_subpath(path)
        self._path = os.path.join(place(), folder)
        with open(path, "rb") as file:
            self._stamp = hashlib.sha256(file.read()).hexdigest()

    def get_cache_path(self) -> str:
        """The folder."""
        return self._path

    def get_source_stamp(self) -> str:
        """What the source must be."""
        return self._stamp


class _VerifiedResults(caching.CompileResultCacheImpl):  # type: ignore[misc]
    """What is kept has a checksum: the machine code of a torn file would be executed."""

    _locator_classes = (_Locator,)  # the others look at the function's own file alone

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
    """Keeps a function, and does without what cannot be read or written."""

    _impl_class = _VerifiedResults

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
            _warn_of(self.cache_path, getattr(error, "strerror", None) or error)


def compiled(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Compile a function when it is first called, without the lock of the interpreter, and keep it;
    a decorator, with the options of `numba.njit`.
    """
    if function is None:
        return lambda given: compiled(given, **options)
    made = njit(nogil=True, **options)(function)
    if folder := place():
        try:
            made._cache = _Kept(function)
        except (OSError, RuntimeError) as error:  # RuntimeError: of numba, without a locator
            _warn_of(folder, getattr(error, "strerror", None) or "numba finds no place there")
    return made


def is_kept(function: Any) -> bool:
    """Whether a compiled function is kept as its source is now, for some type of its arguments."""
    try:
        return bool(function._cache._cache_file._load_index())
    except Exception:  # nothing is kept, or what is kept is damaged
        return False
