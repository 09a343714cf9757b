"""When a run has enough: the rule, what it is held against, and looks that cost little while there is not enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Assessment", "Looks", "StoppingRule"]

Array = NDArray[Any]
_BLOCKS_A_LEVEL = 4
_MOST_DOUBLINGS = 5
_DOUBLINGS_STORED = 2


@dataclass(frozen=True)
class StoppingRule:
    """When to stop: every parameter has bulk and tail ESS ≥ ``ess`` and R-hat ≤ ``rhat``, or ``max_steps`` are spent.

    Attributes
    ----------
    ess, rhat : float
    max_steps : int
        Steps of each ensemble.
    block : int
        Steps between the first looks; later looks are further apart, and of a long run not every step is stored.
    discard : float
        Share of the stored draws given up as burn-in at every look.
    lengths : float
        The kept part must also be this many autocorrelation times long, as implied by the smallest bulk ESS: an ensemble that
        has hardly moved can look well mixed.
    """

    ess: float = 1000.0
    rhat: float = 1.01
    max_steps: int = 20_000
    block: int = 20
    discard: float = 0.25
    lengths: float = 6.0

    def next_block(self, steps: int) -> tuple[int, int]:
        """Draws stored in the block that follows so many steps, and steps between them. The target does not enter."""
        doublings = min(int(np.log2(1.0 + steps / (_BLOCKS_A_LEVEL * self.block))), _MOST_DOUBLINGS)
        thin = 2 ** max(doublings - _DOUBLINGS_STORED, 0)
        return self.block * 2**doublings // thin, thin


@dataclass(frozen=True)
class Assessment:
    """The worst ESS and R-hat over all parameters; ``worst`` is the number of the one with the smallest ESS."""

    ess_bulk_min: float
    ess_tail_min: float
    rhat_max: float
    worst: int = 0

    def meets(self, rule: StoppingRule, *, walkers: int) -> bool:
        """Whether the target is reached by this many walkers in all; false when a diagnostic is not a number."""
        return self.share(rule, walkers=walkers) >= 1.0 and self.rhat_max <= rule.rhat

    def share(self, rule: StoppingRule, *, walkers: int) -> float:
        """How much of the sample sizes asked for there is."""
        shares = (self.ess_bulk_min / rule.ess, self.ess_tail_min / rule.ess)
        return min(shares) if walkers == 0 else min(*shares, self.ess_bulk_min / (rule.lengths * walkers))


class Looks:
    """Assessments of one run that spend no time on what cannot yet be enough."""

    def __init__(
        self,
        assess: Callable[[Array], Assessment],
        complete: Callable[[Array], Array] | None,
        rule: StoppingRule,
        walkers: int,
    ) -> None:
        self._assess, self._complete, self._rule, self._walkers = assess, complete, rule, walkers
        self._worst: int | None = None

    def at(self, chain: Array, *, last: bool) -> Assessment:
        """Of the coordinate that was worst while it misses the rule, then of all, then of the completed chain."""
        if self._worst is not None and not last:
            found = self._assess(chain[..., [self._worst]])
            if not found.meets(self._rule, walkers=self._walkers):
                return found
        found = self._assess(chain)
        self._worst = found.worst
        if self._complete is not None and found.meets(self._rule, walkers=self._walkers):
            found = self._assess(self._complete(chain))
        return found
