"""Columns of a nuisance term, their Gaussian priors, and the hyper-parameters that scale these.

A nuisance term is an effect that is modelled but not of interest. Its columns are its effect on the
readings per unit coefficient. Hyper-parameters are the scales of the noise and of such effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.results import Array, Shown

__all__ = ["FORM_ORDER", "NOISE", "OWN", "BasisNoise", "Columns", "Hyper", "Law", "Scale", "Source"]

# Type of the name of a hyper-parameter (scale of the noise or of another effect).
Hyper = str
# Lists that name the nuisance term of each coefficient have this name for parameters of interest.
OWN = "Parameters"
# Lists that name the nuisance term of each source of noise have this name for the white noise of
# the readings.
NOISE = "ReadingNoise"
# Order n of the harmonic cos nθ, sin nθ at which the scales of ball form and of the machine's
# pattern are stated; prior sds at other orders follow from the decay.
FORM_ORDER = 6.0
# Laws of prior distributions of hyper-parameters (scales of the noise and of other effects).
Law = Literal["half-normal", "decay", "circle"]


class Scale(NamedTuple):
    """A hyper-parameter and its prior: usually the sd [mm] of the coefficients that it scales.

    Hyper-parameters of two laws have no unit: ``decay``, the power by which the amplitude of form
    falls with its order, and ``circle``, the factor λ of one circle, λ² ~ InvGamma(3/2, 3/2).

    Examples
    --------
    >>> scale = lb.terms.Scale("ripple", prior_um=0.5, symbol="r", words="ripple")
    >>> scale.prior_um, scale.law
    (0.5, 'half-normal')
    >>> [scale.name for scale in model.scales]
    ['sigma', 'delta', 'kappa', 'tau', 'decay', 'omega', 'eta']
    """

    name: Hyper  #: name of the hyper-parameter; results append ``_um`` to it
    #: scale of the half-normal prior [µm], or the field of `Prior` that holds it
    prior_um: float | str
    symbol: str = ""  #: symbol in reports, such as σ
    words: str = ""  #: description in reports, such as white noise
    law: Law = "half-normal"  #: law of the prior: half-normal, decay or circle

    def __repr__(self) -> str:
        return f"Scale({self.name!r})"


class Source(NamedTuple):
    """Factor that hyper-parameters contribute to a prior sd, such as the scale of ball form.

    It is hyper · circle · (order/6)^(−decay). ``hyper`` (a scale), ``circle`` (noise factor λ of a
    circle) and ``decay`` (power of form's decrease with order) name hyper-parameters. A factor
    without its hyper-parameter is 1.
    """

    hyper: Hyper | None = None
    circle: Hyper | None = None
    decay: Hyper | None = None
    order: float = FORM_ORDER

    @property
    def names(self) -> tuple[Hyper, ...]:
        """Names of the hyper-parameters from which the factor is computed."""
        return tuple(name for name in (self.hyper, self.circle, self.decay) if name)

    def at(self, value: Mapping[Hyper, Any]) -> Any:
        """Return the value of the factor for given hyper-parameters.

        ``value`` maps their names to numbers or arrays of one shape; lengths are in mm.
        """
        size: Any = value[self.hyper] if self.hyper else 1.0
        if self.circle:
            size = size * value[self.circle]
        if self.decay:
            size = size * (self.order / FORM_ORDER) ** -value[self.decay]
        return size


@dataclass(frozen=True, eq=False)
class Columns(Shown):
    """Columns of one term's p coefficients, with their Gaussian prior.

    The prior sd of coefficient j is sd_j · hyper · λ_circle · (order_j/6)^(−decay), to which
    ``stated`` is added in quadrature. The Fourier basis of the columns is 1, cos θ, sin θ, cos 2θ,
    sin 2θ, … to the order 12, with the angle θ on the circle.

    Raises
    ------
    InputError
        For columns or sds whose shapes do not agree with the number of names.

    Examples
    --------
    >>> setting = model.bind(campaign).setting
    >>> names = ("five_waves_cos5", "five_waves_sin5")
    >>> columns = lb.terms.Columns(names, setting.harmonics([5]), sd=0.002)
    >>> columns.values.shape, columns.sd
    ((6, 25, 2), array([0.002, 0.002]))
    """

    names: Sequence[str]  #: names of the coefficients; each begins with the term's ``stem``
    values: Array  #: reading per unit coefficient, in the Fourier basis, shape (tests, 25, p)
    #: Prior sd of the p coefficients, shape (p,), or one number for all. It is in units of the
    #: hyper-parameter ``hyper``, or in internal units without one; infinite for a flat prior.
    sd: Any
    hyper: Hyper | None = None  #: name of the hyper-parameter that scales ``sd``
    private: bool = False  #: whether every test has its own copy of each coefficient
    #: prior mean of the p coefficients, shape (p,), or one number for all; default: zero
    mean: Any = None
    #: name of the hyper-parameter d by which ``sd`` falls with the order, as (order/6)^(−d)
    decay: Hyper | None = None
    #: order of the harmonic of each of the p coefficients, shape (p,); needed with ``decay``
    orders: Array | None = None
    #: part of the prior sd that no hyper-parameter scales, shape (p,); it is added in quadrature
    stated: Array | None = None
    #: name of the noise factor λ of each test's circle, for private coefficients; empty for none
    circle: Sequence[Hyper] | Array = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        p = len(self.names)
        for name in ("sd", "mean"):
            value = getattr(self, name)
            if isinstance(value, int | float):
                object.__setattr__(self, name, np.full(p, float(value)))
        require(
            self.values.shape[1:] == (SIZE, p) and self.sd.shape == (p,),
            f"columns of {', '.join(self.names)} must have values of shape (tests, {SIZE}, {p}) and"
            f" sd of shape ({p},), got {self.values.shape} and {self.sd.shape}. Give one of each"
            " for every name.",
        )

    @property
    def sources(self) -> tuple[Source, ...]:
        """Factor from hyper-parameters that scales the prior sd of each coefficient."""
        if self.decay is None or self.orders is None:
            return (Source(self.hyper),) * len(self.names)
        return tuple(
            Source(self.hyper, decay=self.decay, order=float(order)) for order in self.orders
        )

    def sources_of(self, test: int) -> tuple[Source, ...]:
        """Return the factor from hyper-parameters that scales the prior sd of each coefficient.

        It is the factor for one test, with the noise factor λ of the test's circle.
        """
        circle = _circle_of(self.circle, test)
        return tuple(source._replace(circle=circle) for source in self.sources)

    def sd_at(self, value: Mapping[Hyper, Any]) -> Array:
        """Return the prior sds of the p coefficients at given hyper-parameters, shape (..., p).

        ``value`` maps names of hyper-parameters to numbers or arrays (w,); lengths are in mm.
        """
        scaled: Array = self.sd * 1.0
        if self.names:
            sizes = np.broadcast_arrays(*(source.at(value) for source in self.sources))
            scaled = self.sd * np.stack(sizes, axis=-1)
        return scaled if self.stated is None else np.hypot(scaled, self.stated)

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """Return a random draw of the effect on the readings, from the coefficients' prior [mm].

        The effect is given as Fourier coefficients, shape (tests, 25). ``phi`` maps the names of
        the hyper-parameters to their values.
        """
        sd = self.sd_at(phi)
        copies = tests if self.private else 1
        draws = sd * rng.standard_normal((copies, len(sd)))
        if self.mean is not None:
            draws = draws + self.mean
        return np.einsum("tkq,tq->tk", self.values, np.broadcast_to(draws, (tests, len(sd))))


@dataclass(frozen=True, eq=False)
class BasisNoise(Shown):
    """Noise in the Fourier basis: coefficients independent of each other and between tests.

    Their sd is hyper · λ · ``sd``, with the test's λ. The Fourier basis is 1, cos θ, sin θ, cos 2θ,
    sin 2θ, … to the order 12, with the angle θ on the circle.

    Examples
    --------
    Noise of the order 12 alone, with the sd ``ripple``:

    >>> noise = lb.terms.BasisNoise("ripple", np.append(np.zeros(23), np.ones(2)))
    >>> noise.sd_at({"ripple": 0.5e-3}, test=0)[-3:]
    array([0.    , 0.0005, 0.0005])
    """

    hyper: Hyper  #: name of the hyper-parameter that scales ``sd``
    sd: Array  #: sd of each Fourier coefficient in units of ``hyper``, shape (25,)
    #: name of the noise factor λ of each test's circle; empty for none
    circle: Sequence[Hyper] | Array = ()

    @property
    def sources(self) -> tuple[Source, ...]:
        """Factor from hyper-parameters that scales the noise of each test.

        There is one factor for all tests if circles have no noise factor λ of their own.
        """
        if not len(self.circle):
            return (Source(self.hyper),)
        return tuple(Source(self.hyper, str(name) or None) for name in self.circle)

    def source(self, test: int) -> Source:
        """Return the factor from hyper-parameters that scales the noise of one test."""
        return Source(self.hyper, _circle_of(self.circle, test))

    def sd_at(self, value: Mapping[Hyper, Any], test: int) -> Array:
        """Return the sd of one test's 25 Fourier coefficients at given hyper-parameters [mm].

        ``value`` maps names of hyper-parameters to numbers or arrays (w,). Shape (..., 25).
        """
        return np.multiply.outer(self.source(test).at(value), self.sd)

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """Return random draws of the noise of all tests, as Fourier coefficients [mm].

        They have shape (tests, 25). ``phi`` maps names of hyper-parameters to their values.
        """
        sd = np.stack([self.sd_at(phi, test) for test in range(tests)])
        return sd * rng.standard_normal((tests, SIZE))


def _circle_of(circles: Sequence[Hyper] | Array, test: int) -> Hyper | None:
    """Return the name of the noise factor λ of a test's circle, or None if it has none."""
    if not len(circles):
        return None
    return str(circles[test]) or None
