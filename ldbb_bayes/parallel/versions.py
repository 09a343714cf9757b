"""Versions of this package and of the libraries on which its results depend."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import version

import ldbb_bayes

__all__ = ["versions"]

# Names of the libraries whose versions may change the last digits of a result.
_PACKAGES = ("numpy", "scipy", "emcee")


@cache
def versions(*, python: bool = False) -> dict[str, str]:
    """Return the versions of this package and of the libraries on which its results depend.

    Parameters
    ----------
    python : whether to add Python's own version.

    Returns
    -------
    Dict with the version of each package in this process; the keys are the names of the packages.
    """
    by_package = {"ldbb-bayes": ldbb_bayes.__version__}
    for name in _PACKAGES:
        by_package[name] = version(name)
    if python:
        by_package["python"] = platform.python_version()
    return by_package
