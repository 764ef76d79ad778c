"""The apparent contact: registration, background difference, centre, radius, ring means."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
