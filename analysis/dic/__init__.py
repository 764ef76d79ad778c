"""Digital image correlation: the displacement field of the interface between a reference image and
the images of a run.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
