"""Names of a package that are imported when they are first used: to import the package costs
nothing, and a program that needs one module of it loads that one only (PEP 562).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

Exports = tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]


def exports(package: str, names: Mapping[str, str]) -> Exports:
    """The `__all__`, `__getattr__` and `__dir__` of a package.

    Parameters
    ----------
    package : str
        Its dotted name.
    names : mapping
        Module, relative to the package -> names of it that are exported, with blanks between them;
        a module without names is exported itself.
    """
    places = {name: module for module, own in names.items() for name in own.split() or [module]}

    def get(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = import_module(f".{places[name]}", package)
        value = getattr(module, name) if names[places[name]] else module
        setattr(sys.modules[package], name, value)
        return value

    return sorted(places), get, lambda: sorted(places)
