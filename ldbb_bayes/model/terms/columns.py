"""Columns of a term with their Gaussian priors, and the hyper-parameters that scale them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.results import Array, Shown

__all__ = ["BasisNoise", "Columns", "FORM_ORDER", "Hyper", "Law", "NOISE", "OWN", "Scale", "Source"]


Hyper = str


# Whose a coefficient is that is no term's: of the parameters of interest, of the white noise of
# readings.
OWN = "Parameters"


NOISE = "ReadingNoise"


# The order at which τ and ω are the sd of form.
FORM_ORDER = 6.0


Law = Literal["half-normal", "decay", "circle"]


class Scale(NamedTuple):
    """A hyper-parameter: the sd, in mm, of what it scales, with a half-normal prior whose scale
    [µm] is ``prior_um``, or the field of `Prior` of that name. Results add ``_um`` to its name;
    ``symbol`` and ``words`` are for reading.

    Two laws are of numbers without a unit: ``decay``, the power by which form falls with its order,
    and ``circle``, λ of one circle, λ² ~ InvGamma(3/2, 3/2).
    """

    name: Hyper
    prior_um: float | str
    symbol: str = ""
    words: str = ""
    law: Law = "half-normal"

    def __repr__(self) -> str:
        return f"Scale({self.name!r})"


class Source(NamedTuple):
    """What an sd is a known multiple of: a hyper-parameter times a circle's λ times
    (order/6)^(−decay); 1 without them."""

    hyper: Hyper | None = None
    circle: Hyper | None = None
    decay: Hyper | None = None
    order: float = FORM_ORDER

    def at(self, value: Mapping[Hyper, Any]) -> Any:
        """Its value at those of the hyper-parameters [mm], of any shape."""
        size = value[self.hyper] if self.hyper else 1.0
        size = size * value[self.circle] if self.circle else size
        return size * (self.order / FORM_ORDER) ** -value[self.decay] if self.decay else size


@dataclass(frozen=True, eq=False)
class Columns(Shown):
    """Columns of one term with their Gaussian prior, p coefficients."""

    names: tuple[str, ...]  #: they begin with the term's ``stem``
    values: Array  #: shape (tests, 25, p)
    #: Prior sd (p,), or one number for all: in units of ``hyper`` where one is named, else in mm; infinite for a flat prior.
    sd: Any
    hyper: Hyper | None = None  #: the hyper-parameter that scales ``sd``
    private: bool = False  #: every test has its own copy of each coefficient
    mean: Array | None = None  #: prior mean (p,) of shared coefficients; default: zero
    decay: Hyper | None = None  #: the hyper-parameter p by which ``sd`` falls as (order/6)^(−p)
    orders: Array | None = None  #: of each coefficient (p,), with ``decay``
    stated: Array | None = None  #: sd (p,) that no hyper-parameter scales, added in quadrature
    #: names of the scales λ of private coefficients, one a test, as of `BasisNoise`
    circle: Sequence[Hyper] | Array = ()

    def __post_init__(self) -> None:
        p = len(self.names)
        for name in ("sd", "mean"):
            if isinstance(value := getattr(self, name), int | float):
                object.__setattr__(self, name, np.full(p, float(value)))
        require(
            self.values.shape[1:] == (SIZE, p) and self.sd.shape == (p,),
            f"columns of {', '.join(self.names)} must have values of shape (tests, {SIZE}, {p}) and"
            f" sd of shape ({p},), got {self.values.shape} and {self.sd.shape}. Give one of each"
            " for every name.",
        )

    @property
    def sources(self) -> tuple[Source, ...]:
        """Of each coefficient."""
        if self.decay is None or self.orders is None:
            return (Source(self.hyper),) * len(self.names)
        return tuple(Source(self.hyper, None, self.decay, float(n)) for n in self.orders)

    def sources_of(self, test: int) -> tuple[Source, ...]:
        """Of each coefficient of one test."""
        circle = (str(self.circle[test]) or None) if len(self.circle) else None
        return tuple(source._replace(circle=circle) for source in self.sources)

    def sd_at(self, value: Mapping[Hyper, Any]) -> Array:
        """Prior sd at hyper-parameters, numbers or arrays (w,) [mm], shape (..., p)."""
        sizes = (
            np.broadcast_arrays(*(source.at(value) for source in self.sources))
            if self.names
            else [np.zeros(0)]
        )
        scaled = self.sd * (np.stack(sizes, axis=-1) if self.names else 1.0)
        return scaled if self.stated is None else np.hypot(scaled, self.stated)

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """What one draw from the prior at φ adds to the readings' coefficients, shape (tests, 25)
        [mm]."""
        sd = self.sd_at(phi)
        drawn = sd * rng.standard_normal((tests if self.private else 1, len(sd)))
        drawn = drawn if self.mean is None else drawn + self.mean
        return np.einsum("tkq,tq->tk", self.values, np.broadcast_to(drawn, (tests, len(sd))))


@dataclass(frozen=True, eq=False)
class BasisNoise(Shown):
    """Independent coefficients on the basis itself, separate for every test: sd = hyper · λ ·
    ``sd`` (25,); ``circle`` (tests,): the name of each test's λ, empty for none."""

    hyper: Hyper
    sd: Array
    circle: Sequence[Hyper] | Array = ()

    @property
    def sources(self) -> tuple[Source, ...]:
        """Of each test; one alone where circles have no λ."""
        return tuple(Source(self.hyper, str(name) or None) for name in self.circle) or (
            Source(self.hyper),
        )

    def source(self, test: int) -> Source:
        """Of one test."""
        return self.sources[test if len(self.circle) else 0]

    def sd_at(self, value: Mapping[Hyper, Any], test: int) -> Array:
        """Their sd at hyper-parameters, numbers or arrays (w,) [mm], shape (..., 25)."""
        return np.multiply.outer(self.source(test).at(value), self.sd)

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """One draw of them, shape (tests, 25) [mm]."""
        return np.stack([self.sd_at(phi, r) for r in range(tests)]) * rng.standard_normal(
            (tests, SIZE)
        )
