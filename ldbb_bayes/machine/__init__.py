"""Model of the machine: kinematic chain, readings, and effects of parameters on the readings."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
