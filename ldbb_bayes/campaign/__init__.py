"""Circular tests, campaigns and plans, and the files in which they are stored."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
