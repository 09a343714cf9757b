"""What a comparison says, in words: how strong the evidence is, and what it hangs on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ldbb_bayes.analysis.assumptions import WHITE_NOISE, Assumed
from ldbb_bayes.model.wording import joined

if TYPE_CHECKING:
    from ldbb_bayes.analysis.compared import Comparison

__all__ = ["strength", "turned", "verdict_of"]

_STRENGTHS = ((1.0, "not worth more than a bare mention"), (3.0, "positive evidence"), (5.0, "strong evidence"))
_VERY_STRONG = "very strong evidence"
_REJECTED = 5.0
_SURE = 0.95
_DISAGREE = 0.05


def strength(log_bayes_factor: float) -> str:
    """Words for a log Bayes factor of either sign (Kass and Raftery, J. Am. Stat. Assoc. 90, 773-795, 1995)."""
    return next((words for limit, words in _STRENGTHS if abs(log_bayes_factor) < limit), _VERY_STRONG)


def turned(comparison: Comparison) -> tuple[tuple[Assumed, float], ...]:
    """Assumptions that turn the sign of the log Bayes factor, each with ln of its evidence over the models' own."""
    sign = np.sign(comparison.log_bayes_factor[comparison.ratio][0])
    own = _best(comparison.nuisances[0])
    every = {a.label: a for a in (*comparison.discrepancy_sensitivity, *comparison.nuisances)}
    shown = {a.log_bayes_factor: a for a in reversed(every.values())}
    return tuple(
        sorted(
            ((a, _best(a) - own) for a in shown.values() if np.sign(a.log_bayes_factor) == -sign and a.label != WHITE_NOISE),
            key=lambda pair: -pair[1],
        )
    )


def verdict_of(comparison: Comparison, notes: Sequence[str] = ()) -> tuple[str, ...]:
    """The comparison in sentences: the evidence, whether its sign is robust, and what else speaks."""
    parts = (_evidence, _robustness, _left_out, _slopes, _fit)
    return (*(sentence for part in parts for sentence in part(comparison)), *notes)


def _evidence(comparison: Comparison) -> Iterator[str]:
    first, second = comparison.pair
    value, error = comparison.log_bayes_factor[comparison.ratio]
    favoured = second if value > 0 else first
    weight = strength(value)
    says = f"{weight}, in favour of {favoured}" if abs(value) >= _STRENGTHS[0][0] else f"{weight} either way"
    shares = joined([f"{name} {_share(model.probability)}" for name, model in comparison.models.items()])
    yield f"ln B({comparison.ratio}) = {value:+.2f} ± {_error(error)}: {says}. Probabilities at equal prior odds: {shares}."
    for ratio, (other, own_error) in comparison.savage_dickey.items():
        direct, direct_error = comparison.log_bayes_factor[ratio]
        if abs(other - direct) <= _DISAGREE and own_error <= _DISAGREE:
            yield f"A second route (Savage-Dickey) gives ln B({ratio}) = {other:+.2f} ± {_error(own_error)}."
        else:
            yield (
                f"The second route (Savage-Dickey) gives ln B({ratio}) = {other:+.2f} ± {_error(own_error)}, the first "
                f"{direct:+.2f} ± {_error(direct_error)}: trust no more than they share."
            )


def _robustness(comparison: Comparison) -> Iterator[str]:
    changes = turned(comparison)
    scales = comparison.prior_sensitivity
    allowed = [assumed for assumed, own in changes if own > -_REJECTED]
    if allowed or comparison.crossings:
        yield "The sign is NOT robust: it depends on what is assumed."
    elif changes:
        yield "The sign holds under every assumption that the readings do not reject."
    else:
        yield "The sign holds under every assumption tried."
    if scales:
        values = [scaled.log_bayes_factor for scaled in scales]
        zeros = joined([f"{crossing:.2g}" for crossing in comparison.crossings])
        sign = f"changing sign at {zeros}" if zeros else "of one sign"
        yield (
            f"With slopes expected at {scales[0].slope_scale:g} to {scales[-1].slope_scale:g} times sd(C)/(F_max − F_min) "
            f"it lies between {min(values):+.1f} and {max(values):+.1f}, {sign}."
        )
    better = _preferred(comparison)
    if better is not None:
        gain = _best(better) - _best(comparison.nuisances[0])
        yield (
            f"The readings prefer '{better.label}' by {gain:.1f} nats to what the models assume: under it ln B is "
            f"{better.log_bayes_factor:+.1f}. Consider making it the model."
        )
    open_ = [(a, own) for a, own in changes if own > -_REJECTED]
    closed = [(a, own) for a, own in changes if own <= -_REJECTED]
    for assumed, own in open_:
        yield (
            f"With '{assumed.label}' it is {assumed.log_bayes_factor:+.1f}, and the readings do not rule that assumption out "
            f"(its evidence is {own:+.1f} nats against the models' own)."
        )
    if closed:
        listed = joined([f"'{a.label}' ({a.log_bayes_factor:+.0f})" for a, _ in closed])
        also = "also " if allowed or comparison.crossings else ""
        yield f"It {also}turns with {listed}, assumptions the readings reject by {-closed[0][1]:.0f} nats and more."
    naive = next((assumed for assumed in comparison.nuisances if assumed.label == WHITE_NOISE), None)
    if naive is not None:
        yield (
            f"White noise alone, without nuisances and truncation, would say {naive.log_bayes_factor:+.0f}: "
            f"{abs(comparison.overstatement):.0f} nats away, because it counts every reading as an independent fact."
        )


def _left_out(comparison: Comparison) -> Iterator[str]:
    if comparison.elpd_difference:
        value, spread = comparison.elpd_difference[comparison.ratio]
        better = comparison.pair[int(value > 0)]
        says = "no difference to speak of" if abs(value) < 2.0 * spread else f"in favour of {better}"
        value = round(value, 1) + 0.0
        yield (
            f"With one force left out at a time, {better} predicts it better by {abs(value):.1f} ± {spread:.1f} nats: {says} "
            f"({len(comparison.tests)} tests, so the ± is rough itself)."
        )
    smoothed = [name for name, test in comparison.tests.items() if max(test.pareto_k.values()) > test.good_k]
    if smoothed:
        yield (
            f"Importance sampling (PSIS-LOO) cannot be trusted for {joined(smoothed)} (Pareto k above "
            f"{comparison.tests[smoothed[0]].good_k:.2g}); all numbers here are the exact ones."
        )
    flagged = [name for name, test in comparison.tests.items() if test.belonging.flag]
    for name in flagged:
        belonging = comparison.tests[name].belonging
        yield (
            f"{name} does not belong with the others (family-wise p = {belonging.family_wise_p_value:.2g}, most in order "
            f"{belonging.worst_order}): look at it, and compare again without it, for it weighs on all of the above."
        )
    at_odds = [name for name, test in comparison.tests.items() if test.belonging.stands_out and not test.belonging.flag]
    if at_odds:
        yield f"{joined(at_odds)} disagree with one another, and nothing says which is wrong: add tests."
    if comparison.tests and not flagged and not at_odds:
        smallest = min(test.belonging.family_wise_p_value for test in comparison.tests.values())
        yield f"Every test belongs with the others (smallest family-wise p = {smallest:.2g})."


def _slopes(comparison: Comparison) -> Iterator[str]:
    slopes = comparison.slopes
    if slopes is None:
        return
    prior = "there or not with probability ½" if not slopes.quadratic else "none, linear or quadratic with probability ⅓ each"
    listed = [f"{name} {p:.2f}" for name, p in sorted(slopes.inclusion.items(), key=lambda pair: -pair[1])]
    sure = joined([name for name, p in slopes.inclusion.items() if p >= _SURE])
    none = next(subset.probability for subset in slopes.subsets if not subset.varying)
    best = slopes.subsets[0]
    if slopes.possible > len(slopes.subsets):
        yield (
            f"Of {slopes.possible} sets of slopes the {len(slopes.subsets)} found from the best to its neighbours are weighed: "
            "probabilities are among these."
        )
    yield (
        f"Slopes one by one (each {prior} beforehand): {', '.join(listed)}; beyond {_SURE:g}: "
        f"{sure or 'none'}. No slope at all has probability {none:.2g}, the likeliest set "
        f"({joined(list(best.words)) or 'none'}) {best.probability:.2g}. A single slope asks for less evidence than all of "
        "them at once, which is what the models compared above differ by."
    )


def _fit(comparison: Comparison) -> Iterator[str]:
    smaller, larger = sorted((comparison.models[name] for name in comparison.pair), key=lambda model: model.degree)
    before, after = smaller.least_squares_rmse_um, larger.least_squares_rmse_um
    if np.isfinite(before) and np.isfinite(after) and smaller.degree != larger.degree:
        yield (
            f"By least squares the RMSE (Eq. 34) goes from {before:.2f} ({smaller.name}) to {after:.2f} µm ({larger.name}), "
            f"{100 * (after / before - 1):+.0f} %: more parameters always lower it, so it is no evidence by itself."
        )
    if not comparison.within_tolerance:
        error, asked = comparison.largest_error, comparison.tolerance
        yield (
            f"A log evidence has an error of {error:.2g} nats, more than the {asked:g} asked for: read ln B with that error, or "
            f"ask for a tolerance of {error:.1g} (--tolerance)."
        )


def _preferred(comparison: Comparison) -> Assumed | None:
    """The assumption with most evidence, where that is so much more than the models' own that they would be rejected for it."""
    every = (*comparison.discrepancy_sensitivity, *comparison.nuisances)
    best = max(every, key=_best)
    return best if _best(best) - _best(comparison.nuisances[0]) > _REJECTED else None


def _best(assumed: Assumed) -> float:
    return max(assumed.log_evidence.values())


def _share(probability: float) -> str:
    return f"{probability:.3f}" if 0.001 <= probability <= 0.999 else f"{probability:.2g}" if probability < 0.5 else "> 0.999"


def _error(error: float) -> str:
    return f"{max(error, 1e-3):.1g}"
