"""Figures: every one is a function of a posterior, or of another result, that returns a Figure.

PALETTE, force_colours, new_figure and styled are for figures of one's own in the same style.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
