"""Note on the set-up that is assumed for circles of several planes or centres."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.reading.assumptions import AssumptionLog

__all__ = ["note_assumed_setup"]


def note_assumed_setup(
    campaign: Campaign, stated: Sequence[CircularTest], log: AssumptionLog
) -> None:
    """Add a note to the log if circles of several planes or centres state no set-up.

    ``stated`` are the tests of ``campaign`` with the fields that the files and the user state, in
    the same order; in the campaign itself, every test has a set-up.

    Tests without a set-up count as tests of set-up 1, in which the offsets of the tool ball are the
    same in all circles. For circles of one plane and centre, this is usual. In another plane or at
    another centre, the bar may have been mounted anew.
    """
    places = set()
    for test, stated_test in zip(campaign.tests, stated, strict=True):
        if stated_test.setup is None:
            places.add((test.plane, test.circle.centre_mm))
    if len(places) > 1:
        value = "1 in all planes and centres: the bar stays mounted"
        log.add("", "setup", value, "none stated", "a column 'setup', or a [[test]] in --layout")
