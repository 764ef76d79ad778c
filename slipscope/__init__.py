"""SlipScope from Python: record, read, analyse and draw friction experiments.

>>> import slipscope
>>> [name for name in slipscope.__all__ if name.islower()]
['analysis', 'analyze', 'dic', 'export', 'figures', 'invert', 'run', 'theory']

`Session` reads a recorded experiment, `Results` what `analyze` made of several; `run`, `analyze`,
`figures` and `export` do what the commands of these names do. `invert`, `dic` and `theory`, the
most used parts of `analysis`, work on plain arrays. Each name is imported when it is first used.
"""

import importlib.util
import os
import sys
from pathlib import Path

import lazy_loader


def _hidden() -> str:
    """Which file of somebody else is found under the name of a package of the program, and what to
    do; empty for none.
    """
    for name in ("analysis", "app", "drivers"):
        own = Path(__file__).parents[1] / name / "__init__.py"
        spec = importlib.util.find_spec(name)
        found = spec.origin if spec else None
        if found and own.exists() and not os.path.samefile(found, own):
            return (
                f"{found} is found in place of SlipScope's own package '{name}'; rename it, or"
                " start Python in another folder"
            )
    return ""


if _sentence := _hidden():
    if Path(sys.argv[0]).stem == "slipscope" or sys.argv[0] == "-m":  # the command
        print(f"slipscope: {_sentence}", file=sys.stderr)
        sys.exit(2)
    raise ImportError(_sentence)

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
