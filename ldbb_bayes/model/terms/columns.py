"""Columns of nuisance terms, Gaussian priors of their coefficients, and hyper-parameters.

A nuisance term is an effect that is modelled but not of interest. A column of a term is the effect
on the readings per unit of one coefficient of the term. Hyper-parameters scale the prior standard
deviations of the coefficients, and the standard deviations of the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.results import Array, Shown

__all__ = [
    "FORM_ORDER",
    "NOISE",
    "PARAMETERS",
    "BasisNoise",
    "Columns",
    "Hyper",
    "Law",
    "Scale",
    "Source",
]

# Type of the name of a hyper-parameter (scale of the noise or of another effect), such as sigma.
Hyper = str
# Some lists state to which term each coefficient of a model belongs. For a coefficient of a
# nuisance term, they hold the name of the class of the term. A parameter of interest belongs to no
# nuisance term; for it, they hold this text.
PARAMETERS = "Parameters"
# Name of the white noise of the readings in lists of the sources of noise. All other sources in
# these lists are nuisance terms, which are listed by the names of their classes.
NOISE = "ReadingNoise"
# The scale τ of the balls' form errors and the scale ω of the machine's errors of higher orders are
# the prior sds of harmonics of this order. For harmonics of another order n, the scales are
# multiplied by (n/6)^(−decay).
FORM_ORDER = 6.0
# Kinds of prior distribution of a hyper-parameter. ``half-normal`` is for standard deviations.
# ``decay`` is for the exponent p in a prior sd that is proportional to n^(−p), where n is the order
# of a form error. ``circle`` is for the factor λ that multiplies the noise of one circle.
Law = Literal["half-normal", "decay", "circle"]


class Scale(NamedTuple):
    """Hyper-parameter of the model, with its prior.

    The field ``law`` names the kind of the hyper-parameter. Most hyper-parameters are prior sds of
    coefficients or of noise [mm], and have a half-normal prior (``half-normal``). The two other
    kinds have no unit. ``decay`` is the exponent p: the prior sd of a form error of order n is
    proportional to n^(−p). ``circle`` is the factor λ that multiplies the noise of one circle; λ²
    has the inverse gamma prior InvGamma(3/2, 3/2).

    Examples
    --------
    >>> scale = lb.terms.Scale("ripple", prior_um=0.5, symbol="r", words="ripple")
    >>> scale.prior_um, scale.law
    (0.5, 'half-normal')
    >>> [scale.name for scale in model.scales]
    ['sigma', 'delta', 'kappa', 'tau', 'decay', 'omega', 'eta']
    """

    #: name of a hyper-parameter, such as sigma; if it is a length, its name in results ends with
    #: ``_um``
    name: Hyper
    #: number that defines the prior of a hyper-parameter, or the name of the field of `Prior` that
    #: holds this number. If ``law`` is ``half-normal``, it is the scale of the prior [µm]. If
    #: ``law`` is ``decay``, it is the prior mean of the exponent p. If ``law`` is ``circle``, it is
    #: not used
    prior_um: float | str
    symbol: str = ""  #: symbol of a hyper-parameter in reports, such as σ
    words: str = ""  #: description of a hyper-parameter in reports, such as white noise for σ
    #: kind of the hyper-parameter and of its prior: ``half-normal`` for a prior sd, ``decay`` for
    #: the exponent with which prior sds decrease with the Fourier order, or ``circle`` for the
    #: factor λ that multiplies the noise of one circle
    law: Law = "half-normal"

    def __repr__(self) -> str:
        """Return a short text with the name of the hyper-parameter, such as Scale('sigma')."""
        return f"Scale({self.name!r})"


class Source(NamedTuple):
    """Product of hyper-parameters by which the prior sd of a coefficient is multiplied.

    The product is hyper · circle · (order/6)^(−decay). ``hyper``, ``circle`` and ``decay`` name the
    hyper-parameters in this product: the scale of an effect, the factor λ on the noise of a circle,
    and the exponent with which the prior sd decreases with the Fourier order. If one of these names
    is None, the corresponding factor of the product is 1. ``order`` is the order of the
    coefficient's harmonic.
    """

    hyper: Hyper | None = None
    circle: Hyper | None = None
    decay: Hyper | None = None
    order: float = FORM_ORDER

    @property
    def names(self) -> tuple[Hyper, ...]:
        """Names of the hyper-parameters by which the prior sd of a coefficient is multiplied."""
        return tuple(name for name in (self.hyper, self.circle, self.decay) if name)

    def at(self, value: Mapping[Hyper, Any]) -> Any:
        """Return the product of hyper-parameters that multiplies the prior sd of a coefficient.

        ``value`` maps the names of the hyper-parameters to numbers, or to arrays of one shape;
        lengths are in mm. The result is a number or an array of the same shape.
        """
        size: Any = value[self.hyper] if self.hyper else 1.0
        if self.circle:
            size = size * value[self.circle]
        if self.decay:
            size = size * (self.order / FORM_ORDER) ** -value[self.decay]
        return size


@dataclass(frozen=True, eq=False)
class Columns(Shown):
    """Columns of one term's p coefficients, with the Gaussian prior of the coefficients.

    A column is the change of the reading per unit of a coefficient, as a function of the angle θ on
    the circle. Each column is stored as Fourier coefficients of 1, cos θ, sin θ, cos 2θ, sin 2θ, …
    to the order 12.

    The prior sd of coefficient j is ``sd``_j · s · λ · (``orders``_j/6)^(−d). The hyper-parameters
    are the scale s of the effect, the noise factor λ of each test's circle, and the exponent d of
    the decrease with the order. The fields ``hyper``, ``circle`` and ``decay`` name them. If a
    field names no hyper-parameter, its factor is 1. If the field ``stated`` is given, its value for
    coefficient j is added to this sd in quadrature.

    Raises
    ------
    InputError
        If the shapes of ``values``, ``sd`` or ``mean`` do not agree with the number of names, if
        two names are the same, or if numbers are not finite. The error is also raised if
        coefficients with separate values in every test (``private``) have a prior mean, or if other
        coefficients have noise factors of circles (``circle``).

    Examples
    --------
    >>> setting = model.bind(campaign).setting
    >>> names = ("five_waves_cos5", "five_waves_sin5")
    >>> columns = lb.terms.Columns(names, setting.harmonics([5]), sd=0.002)
    >>> columns.values.shape, columns.sd
    ((6, 25, 2), array([0.002, 0.002]))
    """

    #: names of the p coefficients, each of which begins with the ``stem`` of the nuisance term
    names: Sequence[str]
    #: change of the reading per unit of each of the p coefficients, as 25 Fourier coefficients for
    #: each test, shape (tests, 25, p)
    values: Array
    #: prior sd of each of the p coefficients, shape (p,), or one number for all. If ``hyper`` names
    #: a hyper-parameter, ``sd`` is the prior sd divided by this hyper-parameter; otherwise ``sd``
    #: is in internal units (mm, N, rad). For a flat prior, ``sd`` is infinite.
    sd: Any
    #: name of the hyper-parameter (scale of an effect) by which ``sd`` is multiplied to obtain the
    #: prior sd of the coefficients; None if there is no such hyper-parameter
    hyper: Hyper | None = None
    #: whether each coefficient has a separate value in every test, instead of one value for all
    #: tests
    private: bool = False
    #: prior mean of each of the p coefficients, shape (p,), or one number for all, in the internal
    #: units of the coefficients (mm for lengths, N for forces, rad for angles). None stands for
    #: zero. If coefficients have a separate value in every test, the mean must be None
    mean: Any = None
    #: name of the hyper-parameter d if the prior sd is proportional to (n/6)^(−d), where n is the
    #: order of the harmonic; None if the prior sd does not depend on the order
    decay: Hyper | None = None
    #: order n of the harmonic cos nθ or sin nθ to which each of the p coefficients belongs, shape
    #: (p,); needed if ``decay`` is given
    orders: Array | None = None
    #: fixed part of the prior sd of each of the p coefficients, shape (p,), in the internal units
    #: of the coefficients (mm for lengths, N for forces, rad for angles). It is added in quadrature
    #: to the part that depends on hyper-parameters
    stated: Array | None = None
    #: for each test, the name of the hyper-parameter λ (noise factor) that multiplies the noise of
    #: its circle, shape (tests,); empty if circles have no noise factors. It must be empty if the
    #: coefficients have the same values in all tests (``private`` is false)
    circle: Sequence[Hyper] | Array = ()

    def __post_init__(self) -> None:
        """Check the shapes of a term's columns and priors.

        If ``sd`` or ``mean`` is a single number, repeat it for every coefficient.
        """
        names = self.names
        require(
            not isinstance(names, str) and len(set(names)) == len(names),
            f"names of columns must be a list of different names, got {names!r}. Give one for each"
            " coefficient.",
        )
        object.__setattr__(self, "names", tuple(names))
        p = len(names)
        for name in ("sd", "mean"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _numbers_for_each(value, p))
        label = ", ".join(names)
        require(
            self.values.shape[1:] == (SIZE, p) and self.sd.shape == (p,),
            f"columns of {label} must have values of shape (tests, {SIZE}, {p}) and"
            f" sd of shape ({p},), got {self.values.shape} and {self.sd.shape}. Give one of each"
            " for every name.",
        )
        require(
            self.mean is None or self.mean.shape == (p,),
            f"columns of {label} must have a mean of shape ({p},), got"
            f" {np.shape(self.mean)}. Give one for every name, or one number for all.",
        )
        require(
            bool(np.isfinite(self.values).all()) and not np.isnan(self.sd).any(),
            f"values and sd of the columns of {label} must be numbers, got some that are not"
            " finite. Look for a division by zero.",
        )
        require(
            self.mean is None or not self.private,
            f"private columns of {', '.join(self.names)} must have the prior mean zero, got a mean:"
            " each circle has a coefficient of its own, whose mean results could not show. Put the"
            " mean into columns that are not private, with a small sd.",
        )
        require(
            self.private or not len(self.circle),
            f"columns of {', '.join(self.names)} must be private to have noise factors of circles,"
            " got circle without private=True. Leave circle out.",
        )

    @property
    def prior_mean(self) -> Array:
        """Prior mean of each of the p coefficients in their internal units, shape (p,)."""
        if self.mean is None:
            return np.zeros(len(self.names))
        return np.asarray(self.mean)

    @property
    def sources(self) -> tuple[Source, ...]:
        """For each coefficient, the product of hyper-parameters that multiplies its prior sd.

        The factors λ on the noise of single circles are not included.
        """
        if self.decay is None or self.orders is None:
            return (Source(self.hyper),) * len(self.names)
        return tuple(
            Source(self.hyper, decay=self.decay, order=float(order)) for order in self.orders
        )

    def sources_of(self, test: int) -> tuple[Source, ...]:
        """Return the product of hyper-parameters that multiplies the prior sd of each coefficient.

        The result holds one product for each of the p coefficients of a nuisance term. ``test`` is
        the index of a test. If its circle has a noise factor λ, the products include this factor.
        """
        circle = _circle_of(self.circle, test)
        return tuple(source._replace(circle=circle) for source in self.sources)

    def sd_at(self, value: Mapping[Hyper, Any], test: int | None = None) -> Array:
        """Return the prior sds of the p coefficients at given hyper-parameters, shape (..., p).

        ``value`` maps the names of the hyper-parameters to numbers, or to arrays of shape (w,) for
        w sets of hyper-parameters; lengths are in mm. The result has the shape (p,) or (w, p). The
        sds include the fixed part in the field ``stated``, which does not depend on
        hyper-parameters. ``test`` is the index of a test, from 0. If it is given, the noise factor
        λ of this test's circle multiplies the sds of ``private`` coefficients.
        """
        circle = None
        if test is not None:
            circle = _circle_of(self.circle, test)
        scaled = np.multiply.outer(Source(self.hyper, circle).at(value), self.sd)
        if self.decay is not None and self.orders is not None:
            power = -np.asarray(value[self.decay])
            scaled = scaled * (self.orders / FORM_ORDER) ** power[..., None]
        return scaled if self.stated is None else np.hypot(scaled, self.stated)

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """Return a random draw of a nuisance term's effect on the readings of all tests [mm].

        The coefficients of the term are drawn from their prior with the random number generator
        ``rng``. The result holds Fourier coefficients, shape (tests, 25). ``phi`` maps the names of
        the hyper-parameters to their values, with lengths in mm; ``tests`` is the number of tests.
        """
        return self.effect_of(self.draw_coefficients(phi, tests, rng))

    def draw_coefficients(
        self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator
    ) -> Array:
        """Return a random draw of the p coefficients in every test, shape (tests, p).

        The coefficients are drawn from their prior with the random number generator ``rng``, in
        internal units (mm, N, rad). If they are not ``private``, all tests have the same values.
        ``phi`` maps the names of the hyper-parameters to their values, with lengths in mm;
        ``tests`` is the number of tests.
        """
        p = len(self.names)
        if self.private:
            sd = np.stack([self.sd_at(phi, test) for test in range(tests)])
            draws = sd * rng.standard_normal((tests, p))
        else:
            draws = self.sd_at(phi) * rng.standard_normal((1, p))
        if self.mean is not None:
            draws = draws + self.mean
        return np.broadcast_to(draws, (tests, p))

    def effect_of(self, coefficients: Array) -> Array:
        """Return the effect of given coefficients on the readings of all tests [mm].

        ``coefficients``, shape (tests, p), holds the p coefficients in every test. The result holds
        Fourier coefficients, shape (tests, 25).
        """
        return np.asarray(np.einsum("tkq,tq->tk", self.values, coefficients))


@dataclass(frozen=True, eq=False)
class BasisNoise(Shown):
    """Noise of the readings, described by the sds of its Fourier coefficients.

    The noise is a function of the angle θ on the circle, with the Fourier coefficients of 1, cos θ,
    sin θ, cos 2θ, sin 2θ, … to the order 12. These coefficients are independent of each other and
    between tests. The sd of a coefficient is s · λ · ``sd``. ``hyper`` names the hyper-parameter s,
    the scale of the effect. ``circle`` names the hyper-parameters λ, the noise factors of the
    tests' circles; without these names, λ is 1.

    Raises
    ------
    InputError
        If ``sd`` has another shape, or a negative number.

    Examples
    --------
    Noise of the order 12 alone, with the sd ``ripple``:

    >>> noise = lb.terms.BasisNoise("ripple", np.append(np.zeros(23), np.ones(2)))
    >>> noise.sd_at({"ripple": 0.5e-3}, test=0)[-3:]
    array([0.    , 0.0005, 0.0005])
    """

    #: name of the hyper-parameter by which the standard deviations ``sd`` of the noise are
    #: multiplied
    hyper: Hyper
    #: sd of each of the 25 Fourier coefficients of the noise, shape (25,), before it is multiplied
    #: by hyper-parameters, or one number for all
    sd: Any
    #: for each test, the name of the hyper-parameter λ (noise factor) that multiplies the noise of
    #: its circle, shape (tests,); empty if circles have no noise factors
    circle: Sequence[Hyper] | Array = ()

    def __post_init__(self) -> None:
        """Check the sds of the noise; repeat a single number for every Fourier coefficient."""
        object.__setattr__(self, "sd", _numbers_for_each(self.sd, SIZE))
        require(
            self.sd.shape == (SIZE,) and bool((self.sd >= 0.0).all()),
            f"noise must have an sd of shape ({SIZE},), none negative, got one of shape"
            f" {self.sd.shape}. Give one for each of 1, cos θ, sin θ, … sin 12θ.",
        )

    @property
    def sources(self) -> tuple[Source, ...]:
        """Products of hyper-parameters by which the sds of the tests' noise are multiplied.

        There is one product for each test, which includes the noise factor λ of the test's circle.
        If circles have no noise factors, there is a single product for all tests.
        """
        if not len(self.circle):
            return (Source(self.hyper),)
        return tuple(Source(self.hyper, str(name) or None) for name in self.circle)

    def source(self, test: int) -> Source:
        """Return the product of hyper-parameters that multiplies the sd of the noise of a test.

        ``test`` is the index of the test, from 0. The product includes the noise factor λ of the
        test's circle.
        """
        return Source(self.hyper, _circle_of(self.circle, test))

    def sd_at(self, value: Mapping[Hyper, Any], test: int) -> Array:
        """Return the sd of the 25 Fourier coefficients of the noise of one test [mm].

        ``value`` maps the names of the hyper-parameters to numbers, or to arrays of shape (w,) for
        w sets of hyper-parameters; lengths are in mm. ``test`` is the index of the test, from 0.
        The result has the shape (25,) or (w, 25).
        """
        return np.multiply.outer(self.source(test).at(value), self.sd)

    def draw(self, phi: Mapping[Hyper, float], tests: int, rng: np.random.Generator) -> Array:
        """Return a random draw of the noise of all tests, as Fourier coefficients [mm].

        The coefficients have the shape (tests, 25), where ``tests`` is the number of tests. ``rng``
        is the random number generator. ``phi`` maps the names of the hyper-parameters to their
        values, with lengths in mm.
        """
        sd = np.stack([self.sd_at(phi, test) for test in range(tests)])
        return sd * rng.standard_normal((tests, SIZE))


def _numbers_for_each(value: Any, count: int) -> Array:
    """Return numbers as an array; a single number is repeated ``count`` times."""
    numbers = np.asarray(value, dtype=float)
    return np.full(count, numbers) if numbers.ndim == 0 else numbers


def _circle_of(circles: Sequence[Hyper] | Array, test: int) -> Hyper | None:
    """Return the name of the hyper-parameter λ that multiplies the noise of a test's circle.

    Return None if the circle has no such factor. ``circles`` holds the names for all tests, or is
    empty; ``test`` is the index of the test, from 0.
    """
    if not len(circles):
        return None
    return str(circles[test]) or None
