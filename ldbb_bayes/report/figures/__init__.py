"""Functions that draw figures. Each function takes a result, such as a posterior.

Each function returns a Matplotlib Figure. Users can draw other figures in the same style with
PALETTE (colours), force_colours, new_figure and styled.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
