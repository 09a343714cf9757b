"""Readings and priors as rows of observation equations with diagonal covariance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.reduction import NearUniform, Reduced
from ldbb_bayes.model.terms import BasisNoise, Columns, Source
from ldbb_bayes.results import Array

_LOG_2PI = float(np.log(2 * np.pi))

CROWDED = "crowded"


class Rows(NamedTuple):
    """Rows of readings and priors: what they have of the columns, in units of their prior sd (rows,
    columns), and of the parameters of interest (rows, p); values (rows,); how many each stands for;
    its test, the number of tests for a prior of what all share; and the parts of its variance that
    go with each source squared, (rows, sources)."""

    columns: Array
    interest: Array
    values: Array
    number: Array
    test: NDArray[np.intp]
    variance: Array


def reading_rows(
    reduced: Sequence[Reduced],
    absorbed: Sequence[BasisNoise],
    shared: Sequence[Columns],
    private: Sequence[Columns],
    interest: Array,
    offset: Array,
    sources: list[Source],
    *,
    diagonal: bool,
) -> Rows:
    """Rows of every test's readings, turned so that the absorbed noise is diagonal, and one for all
    that is outside the basis."""
    together, apart = (
        np.concatenate(
            [np.zeros((len(reduced), SIZE, 0)), *(term.values for term in terms)], axis=2
        )
        for terms in (shared, private)
    )
    q = together.shape[2]
    v = apart.shape[2]
    white = np.eye(len(sources))[sources.index(Source("sigma"))]
    found = []
    for r, test in enumerate(reduced):
        turn, factor, spread = _turned(test, absorbed, diagonal=diagonal)
        m = len(factor)
        columns = np.zeros((m + 1, q + len(reduced) * v))
        given = np.zeros((m + 1, interest.shape[2]))
        columns[:m, :q], columns[:m, q + r * v : q + (r + 1) * v] = (
            factor @ together[r],
            factor @ apart[r],
        )
        given[:m] = factor @ interest[r]
        values = (
            np.zeros(m) if test.projection is None else turn @ test.projection - factor @ offset[r]
        )
        variance = np.tile(white, (m + 1, 1))
        number = np.ones(m + 1)
        values, number[m] = (
            np.append(values, np.sqrt(test.residual_ss)),
            max(test.readings - SIZE, 0),
        )
        for term, sd in zip(absorbed, spread, strict=True):
            variance[:m, sources.index(term.source(r))] += sd**2
        found.append(Rows(columns, given, values, number, np.full(m + 1, r), variance))
    return Rows(*(np.concatenate(part) for part in zip(*found, strict=True)))


def _turned(
    test: Reduced, absorbed: Sequence[BasisNoise], *, diagonal: bool
) -> tuple[Array, Array, list[Array]]:
    """The turn (m, m) of a test's rows, the turned factor (m, 25), and the sd of every absorbed
    noise in each row."""
    if diagonal and test.near_uniform is not None:
        size = test.near_uniform.size
        return (
            size[:, None] * np.linalg.inv(test.factor),
            np.diag(size),
            [size * term.sd for term in absorbed],
        )
    left, singular, _ = np.linalg.svd(test.factor * (absorbed[0].sd if absorbed else 1.0))
    return left.T, left.T @ test.factor, [singular][: len(absorbed)]


def add_prior_rows(
    rows: Rows, shared: Sequence[Columns], private: Sequence[Columns], sources: list[Source]
) -> tuple[Rows, Array, float]:
    """The rows in units of the columns' prior sd, flat ones' in units of their own size, with the
    prior's rows below; the units (columns,); and what flat priors add to the log density."""
    tests = int(rows.test[-1]) + 1
    q = sum(len(term.names) for term in shared)
    terms = [*shared, *[*private] * tests]
    sd, stated, mean = (
        np.concatenate(
            [
                np.zeros(0),
                *(np.zeros(len(term.names)) if part is None else part for term, part in of),
            ]
        )
        for of in (
            [(t, t.sd) for t in terms],
            [(t, t.stated) for t in terms],
            [(t, t.mean) for t in terms],
        )
    )
    owner = [sources.index(source) for term in shared for source in term.sources]
    owner += [
        sources.index(source)
        for r in range(tests)
        for term in private
        for source in term.sources_of(r)
    ]
    size = np.linalg.norm(rows.columns, axis=0)
    flat = np.isinf(sd)
    unit = np.where(flat, 1.0 / np.where(size > 0.0, size, 1.0), np.where(sd > 0.0, sd, stated))
    proper = np.flatnonzero(~flat)
    variance = np.zeros((len(sd), len(sources)))
    with np.errstate(invalid="ignore", divide="ignore"):
        for part, place in (
            (sd, np.array(owner, dtype=np.intp)),
            (stated, np.full(len(sd), sources.index(Source()))),
        ):
            share = np.where(unit > 0.0, (part / unit) ** 2, part is sd)
            np.add.at(variance, (np.arange(len(sd)), place), np.where(flat, 0.0, share))
    prior = Rows(
        np.eye(len(sd))[proper],
        np.zeros((len(proper), rows.interest.shape[1])),
        np.divide(mean, unit, out=np.zeros(len(sd)), where=unit > 0.0)[proper],
        np.ones(len(proper)),
        np.where(proper < q, tests, (proper - q) // max((len(sd) - q) // tests, 1)),
        variance[proper],
    )
    both = zip(rows._replace(columns=rows.columns * unit), prior, strict=True)
    return (
        Rows(*(np.concatenate(pair) for pair in both)),
        unit,
        float((np.log(unit[flat]) + 0.5 * _LOG_2PI).sum()),
    )


def columns_of_noise(term: BasisNoise, tests: int) -> Columns:
    """Return basis noise as private columns of every test."""
    used = np.flatnonzero(term.sd)
    values = np.zeros((tests, SIZE, len(used)))
    values[:, used, np.arange(len(used))] = 1.0
    return Columns(
        tuple(f"{term.hyper}_{i}" for i in used),
        values,
        term.sd[used],
        term.hyper,
        private=True,
        circle=term.circle,
    )


def uneven_columns(even: Sequence[NearUniform]) -> list[Columns]:
    """By what the noise of circles exceeds that of uniform ones where readings are missing, and
    falls below it, as a negative variance, where they crowd: σ² (1 + V λ Vᵀ)⁻¹ = σ² (1 − V λ/(1 +
    λ) Vᵀ)."""
    found = []
    for name, sign in (("sparse", -1.0), (CROWDED, 1.0)):
        kept = [np.flatnonzero(own.counts & (sign * own.departure > 0.0)) for own in even]
        values = np.zeros((len(even), SIZE, max(map(len, kept))))
        for part, own, columns in zip(values, even, kept, strict=True):
            share = np.abs(own.departure[columns]) / (1.0 + own.departure[columns])
            part[:, : len(columns)] = own.along[:, columns] * np.sqrt(share) / own.size[:, None]
        names = tuple(f"{name}_{i}" for i in range(values.shape[2]))
        found.append(Columns(names, values, np.ones(len(names)), "sigma", private=True))
    return [own for own in found if own.names]
