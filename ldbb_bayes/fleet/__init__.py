"""Analysis of many campaigns: of a shop floor, one machine over time, or a series of machines."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
