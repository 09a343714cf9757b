"""Figures: functions that take a posterior or another result and return a Matplotlib Figure.

PALETTE (colours), force_colours, new_figure and styled help users to make their own figures in the
same style.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
