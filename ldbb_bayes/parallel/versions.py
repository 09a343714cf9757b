"""Versions of what numbers come from."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import version

import ldbb_bayes

__all__ = ["versions"]

# Packages on which the last digits of a result depend.
_PACKAGES = ("numpy", "scipy", "emcee")


@cache
def versions(*, python: bool = False) -> dict[str, str]:
    """Return the versions of this package and of the libraries that its numbers depend on.

    Parameters
    ----------
    python : whether to add Python's own version.

    Returns
    -------
    Versions by package, of the process that is asked.
    """
    by_package = {"ldbb-bayes": ldbb_bayes.__version__}
    for name in _PACKAGES:
        by_package[name] = version(name)
    if python:
        by_package["python"] = platform.python_version()
    return by_package
