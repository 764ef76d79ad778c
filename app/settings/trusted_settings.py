"""What settings from somebody else may name: devices, and files of this computer. Code that they
name by where it lies runs only once the user has confirmed it, by its SHA-256.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterable
from importlib.machinery import PathFinder
from pathlib import Path

import platformdirs

from app.system.errors import UserError

OURS = ("analysis", "app", "drivers")  # whatever lies elsewhere by that name is not imported
_DEVICE = re.compile(r"[\w.:#+-]+|/dev/[\w.:#+/-]+|\\\\\.\\\w+")
_NETWORK_PORT = re.compile(r"socket://[^\s/?#@]+:\d{1,5}")


def state_folder() -> Path:
    """Where the program keeps what it must remember of this user and computer."""
    own = os.environ.get("SLIPSCOPE_HOME")
    return Path(own) if own else platformdirs.user_state_path("slipscope", appauthor=False)


def check_port(key: str, port: str) -> None:
    """Refuse a port that is neither a device nor on the network: pyserial knows others, which write
    files.

    Raises
    ------
    UserError
    """
    is_device = _DEVICE.fullmatch(port) and ".." not in port.split("/")
    if port and not is_device and not _NETWORK_PORT.fullmatch(port):
        raise UserError(
            f"{key} must be the name of a device, such as 'COM3' or '/dev/ttyUSB0', or"
            f" 'socket://host:port'; found {port[:200]!r}"
        )


def check_server(key: str, server: str) -> None:
    """Refuse the name of a server that is no ``host:port``; `UserError`."""
    if server and not re.fullmatch(r"[^\s/]+:\d{1,5}", server):
        raise UserError(f"{key} must be 'host:port'; found {server[:200]!r}")


def check_local(key: str, name: str) -> None:
    """Refuse the name of a file or folder that is not on a disk of this computer; `UserError`."""
    path = Path(name)
    is_odd = os.path.exists(path) and not (path.is_file() or path.is_dir())
    if "://" in name or name.startswith(("//", "\\\\")) or is_odd:
        raise UserError(
            f"{key} must be a file or folder of this computer; found {name[:200]!r}; copy it here"
        )


# ---------------------------------------------------------------------- code


def fingerprint(path: Path) -> str:
    """SHA-256 of a file, or of the names and contents of all files in a folder, in hexadecimal.

    Raises
    ------
    UserError
        It cannot be read.
    """
    try:
        if not path.is_dir():
            return hashlib.sha256(path.read_bytes()).hexdigest()
        whole = hashlib.sha256()
        for file in sorted(file for file in path.rglob("*") if file.is_file()):
            if file.parent.name != "__pycache__":
                name = file.relative_to(path).as_posix()
                whole.update(f"{fingerprint(file)} {name!r}\n".encode("ascii", "backslashreplace"))
        return whole.hexdigest()
    except OSError as error:
        raise UserError(f"{path}: it cannot be read ({error.strerror}); check the name") from None


def confirm(path: Path) -> str:
    """Remember that this file, or folder of a package, as it is now may be run; its SHA-256.

    Raises
    ------
    UserError
        It cannot be read, or the confirmation cannot be kept.
    """
    known = fingerprint(path)
    folder = state_folder() / "trusted"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        (folder / known).write_text(f"{path.resolve()}\n", "utf-8", "backslashreplace")
    except OSError as error:
        raise UserError(
            f"{folder}: the confirmation of {path} cannot be kept there ({error.strerror}); set"
            " SLIPSCOPE_HOME to a folder of your own"
        ) from None
    return known


def check_confirmed(key: str, path: Path) -> None:
    """Refuse code that the user has not confirmed as it is now; `UserError`."""
    if not (state_folder() / "trusted" / (known := fingerprint(path))).is_file():
        raise UserError(
            f"{key} would run the code in {path}, which you have not confirmed as it is now"
            f' (SHA-256 {known}); if you know where it comes from: slipscope trust "{path}"'
        )


def check_producer(key: str, producer: str) -> None:
    """Refuse a GenTL producer that is neither installed as its vendor does nor confirmed; what is
    not there is not loaded either. `UserError`.
    """
    path = Path(producer).resolve()
    installed = filter(None, os.environ.get("GENICAM_GENTL64_PATH", "").split(os.pathsep))
    if os.path.isfile(path) and path.parent not in {Path(name).resolve() for name in installed}:
        check_confirmed(key, path)


def check_module(key: str, source: str, folders: Iterable[Path]) -> None:
    """Refuse a driver ``package.module:Class`` whose code merely lies in one of these folders or in
    the current one and was not confirmed; nothing is imported. `UserError`.
    """
    top = source.partition(":")[0].partition(".")[0]
    spec = None
    if ":" in source and top.isidentifier() and top not in (*OURS, *sys.builtin_module_names):
        spec = PathFinder.find_spec(top)
    if spec is None:
        return
    where = spec.submodule_search_locations or ([spec.origin] if spec.origin else [])
    near = {folder.resolve() for folder in (Path(), *folders)}
    lying = [path for path in map(Path, where) if path.parent.resolve() in near]
    for path in lying:
        check_confirmed(key, path.resolve())
    if lying:
        # compiled code that lies beside it may be of another source; also for later processes
        sys.pycache_prefix = sys.pycache_prefix or str(state_folder() / "bytecode")
        os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
