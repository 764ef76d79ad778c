"""Contact mechanics of a sphere on a plane: closed forms, the surface of the block as an operator,
and loading under a law of friction. `hertz`, `jkr`, `cattaneo_mindlin` and `greenwood_tripp` are
modules of functions.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
