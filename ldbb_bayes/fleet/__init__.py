"""Analyses of many campaigns: batches of fits, trends of one machine, populations of machines."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
