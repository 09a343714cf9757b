"""Functions that draw figures. Each takes a posterior or another result, and returns a Figure.

The returned object is a Matplotlib Figure. Users can make their own figures in the same style with
PALETTE (colours), force_colours, new_figure and styled.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
