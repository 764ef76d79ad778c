"""How the program was installed, and the command that adds a package to that installation."""

from __future__ import annotations

import sys
import tomllib
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

OURS = "slipscope"
UV_TOOL, PIPX = "uv-receipt.toml", "pipx_metadata.json"  # what each leaves in its environment


def add(package: str, *, needed: bool = False) -> str:
    """The command that installs a package into the running installation, in the version that
    SlipScope asks for.

    Parameters
    ----------
    package : str
        Its name, with its extras: ``"pypylon"``, ``"nidaqmx[grpc]"``.
    needed : bool
        Whether SlipScope itself requires it, so that installing that again brings it.
    """
    wanted = f'"{required(package)}"'
    environment = Path(sys.prefix)
    if (environment / UV_TOOL).exists():
        if needed:
            return f"uv tool upgrade --reinstall {environment.name}"
        return f"{_uv_tool(environment)} --with {wanted}"
    if (environment / PIPX).exists():
        what = "reinstall" if needed else "inject"
        return f"pipx {what} {environment.name}" + ("" if needed else f" {wanted}")
    python = _quoted(sys.executable)
    if find_spec("pip"):
        return f"{python} -m pip install {wanted}"
    return f"uv pip install {wanted} --python {python}"


def required(package: str) -> str:
    """What SlipScope requires of a package, also for an extra: ``pypylon>=26``; its name, if that
    is unknown.
    """
    from packaging.requirements import Requirement

    sought = Requirement(package)
    try:
        declared = metadata.requires(OURS) or []
        extras = ["", *(metadata.metadata(OURS).get_all("Provides-Extra") or ())]
    except metadata.PackageNotFoundError:
        return package
    for one in map(Requirement, declared):
        is_ours = not one.marker or any(one.marker.evaluate({"extra": each}) for each in extras)
        if is_ours and (one.name, one.extras) == (sought.name, sought.extras):
            one.marker = None
            return str(one)
    return package


def _uv_tool(environment: Path) -> str:
    """The command that installs the tool as it is now: `uv` keeps nothing that is not repeated."""
    tool = tomllib.loads((environment / UV_TOOL).read_text(encoding="utf-8"))["tool"]
    own_first = sorted(tool["requirements"], key=lambda one: bool(one["name"] != OURS))
    python = f"--python {_quoted(tool['python'])} " if "python" in tool else ""
    return f"uv tool install {python}" + " --with ".join(map(_as_asked, own_first))


def _as_asked(requirement: dict[str, Any]) -> str:
    """A requirement of the receipt of a tool, as `uv` reads it on its command line."""
    extras = ",".join(requirement.get("extras", ()))
    extras = extras and f"[{extras}]"
    for kind, before in (("editable", "--editable "), ("directory", ""), ("path", "")):
        if kind in requirement:
            return before + _quoted(requirement[kind] + extras)
    named = requirement["name"] + extras
    if "url" in requirement:
        return f'"{named} @ {requirement["url"]}"'
    return f'"{named}{requirement.get("specifier", "")}"'


def _quoted(path: str) -> str:
    return f'"{path}"' if set(" [") & set(path) else path
