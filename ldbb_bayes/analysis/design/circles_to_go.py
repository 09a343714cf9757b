"""Number of further circles after which a campaign should reach all its aims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ldbb_bayes.analysis.design.aims import Aim, total_distance
from ldbb_bayes.analysis.design.aims_so_far import GoalState, ToleranceState
from ldbb_bayes.analysis.design.candidate_covariances import CandidateCovariances
from ldbb_bayes.analysis.design.model_odds import ModelOdds
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.shares import largest_positions
from ldbb_bayes.results import Array

__all__ = ["CirclesToGo", "count_circles_to_go"]

# Largest number of further circles that is tried when the number of circles that a campaign still
# needs is estimated.
_MOST_CIRCLES = 40


class CirclesToGo(NamedTuple):
    """Number of further circles after which all aims of a campaign should be reached."""

    #: number of circles; None if 40 are not enough
    number: int | None
    #: covariances of the p parameters after so many circles, after 40 circles, or after very many
    #: circles if even these do not reach an aim, at K values of the hyper-parameters, shape (K, p,
    #: p)
    covariances: Array

    def reaches(self, aim: Aim) -> bool:
        """Return whether an aim is reached already, or expected to be after these circles."""
        return bool(aim.is_reached or aim.is_expected(self.covariances))

    def decides(self, odds: ModelOdds | None) -> bool:
        """Return whether these circles decide between constant and linear compliance.

        ``odds`` are None if that is not to be decided; the result is then true.
        """
        return odds is None or self.reaches(odds.aim)

    def unreached(
        self, states: Mapping[str, GoalState] | Mapping[str, ToleranceState]
    ) -> tuple[str, ...]:
        """Return the names of the goals or tolerances that these circles do not reach."""
        if self.number is not None:
            return ()
        return tuple(name for name, state in states.items() if not self.reaches(state.aim))


def count_circles_to_go(
    aims: Sequence[Aim], objective: Objective, after_very_many: Array
) -> CirclesToGo:
    """Return the number of further circles after which a campaign should reach all its aims.

    The circles are chosen one after another from the candidates of ``objective``. Each circle is
    the best choice after the circles chosen before; a candidate may be chosen several times. The
    number is None if the aims are not reached after 40 circles. ``after_very_many``, shape (K, p,
    p), are the covariances of the p parameters after very many circles, at K values of the
    hyper-parameters. An aim that they do not reach is not reached after 40 circles either.
    """
    if not all(aim.is_reached or aim.is_expected(after_very_many) for aim in aims):
        return CirclesToGo(None, after_very_many)
    circles = CandidateCovariances(objective)
    for number in range(1, _MOST_CIRCLES + 1):
        circles.run(int(largest_positions(-total_distance(aims, circles.after()))[0]))
        if all(aim.is_reached or aim.is_expected(circles.before) for aim in aims):
            return CirclesToGo(number, circles.before)
    return CirclesToGo(None, circles.before)
