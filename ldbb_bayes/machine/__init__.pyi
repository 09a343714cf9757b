"""Public names of `lb.machine`; each is imported when it is first used."""

from .chain import Circle as Circle
from .exact import exact_reading_mm as exact_reading_mm
from .linear import hybrid_jacobian as hybrid_jacobian
from .linear import patterns as patterns
