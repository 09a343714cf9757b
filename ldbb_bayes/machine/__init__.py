"""Model of the machine: kinematic chain, exact readings, and readings per unit of a parameter."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
