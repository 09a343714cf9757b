"""What a term brings: columns in the circle's basis with their Gaussian priors, or noise on the basis itself, scaled by
hyper-parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol

from numpy.typing import NDArray

from ldbb_bayes.model.setting import Setting

__all__ = ["HYPERS", "BasisNoise", "Columns", "Hyper", "Nuisance"]

Array = NDArray[Any]
Hyper = Literal["sigma", "delta", "delta_0", "delta_1", "kappa", "tau"]
HYPERS: tuple[Hyper, ...] = ("sigma", "delta", "delta_0", "delta_1", "kappa", "tau")


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of one term with their Gaussian prior.

    Attributes
    ----------
    names : tuple of str
    values : ndarray, shape (tests, 25, p)
    sd : ndarray, shape (p,)
        Prior sd; where ``hyper`` names a hyper-parameter, in units of it. Infinite for a flat prior.
    hyper : hyper-parameter that scales ``sd``, or None
    private : bool
        True when every test has its own copy of each coefficient.
    mean : ndarray, shape (p,)
        Prior mean.
    """

    names: tuple[str, ...]
    values: Array
    sd: Array
    hyper: Hyper | None = None
    private: bool = False
    mean: Array | None = None


@dataclass(frozen=True, eq=False)
class BasisNoise:
    """Independent coefficients on the basis itself, separate for every test: sd = hyper · ``sd`` (25,)."""

    hyper: Hyper
    sd: Array


class Nuisance(Protocol):
    """A nuisance term: its class name is its name everywhere."""

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """Hyper-parameters that scale it."""
        ...

    def columns(self, setting: Setting) -> tuple[Columns | BasisNoise, ...]:
        """Columns of the term in a setting."""
        ...
