"""JSON records of results, with sentences."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

from ldbb_bayes.results import registered_function

__all__ = ["with_words"]


@singledispatch
def with_words(result: Any) -> dict[str, Any]:
    """Return the JSON record of a result, with sentences that describe the result.

    Parameters
    ----------
    result : Result
        Result of an analysis, such as `check_campaign` or `fit_population` returns.

    Returns
    -------
    dict
        The record that the method ``as_dict`` of the result returns. For some classes of results,
        the record also has sentences.

    Examples
    --------
    >>> record = lb.report.with_words(lb.check_campaign(campaign))
    >>> record["remarks"]
    ['One direction of travel (or none stated): the readings cannot separate friction in the bar
     from C_XYX.']
    """
    registered = registered_function(with_words, result)
    record: dict[str, Any]
    if registered is not None:
        record = registered(result)
    else:
        record = result.as_dict()
    return record
