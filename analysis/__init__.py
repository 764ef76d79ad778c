"""The paper as functions on plain arrays, in SI units; pixels where a name ends in `_px`.

Prevost, Scheibert and Debregeas, "Probing the micromechanics of a multi-contact interface at the
onset of frictional sliding" (2013). Which section of it is computed by which function:
docs/analysis.md.

All that the packages export is found here too, and imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analysis.calibration import *
    from analysis.contact import *
    from analysis.dic import *
    from analysis.friction import *
    from analysis.inversion import *
    from analysis.mechanics import *
else:
    _PACKAGES = ("mechanics", "inversion", "friction", "contact", "dic", "calibration")

    def __getattr__(name: str) -> Any:
        packages = {one: import_module(f"analysis.{one}") for one in _PACKAGES}
        if name == "__all__":
            return sorted({*packages, *(name for one in packages.values() for name in one.__all__)})
        if name in packages:
            return packages[name]
        for one in packages.values():
            if name in one.__all__:
                return getattr(one, name)
        raise AttributeError(f"module 'analysis' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return __getattr__("__all__")
