"""Analysis of many campaigns: of all machines, one machine over time, or machines of one kind."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
