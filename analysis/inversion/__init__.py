"""Shear stress from displacement: the inverse of u_x = D - G*sigma with the displacement D of the
block far away as an unknown.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
