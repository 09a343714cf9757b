"""Checks of the columns that a nuisance term returns, such as one that a user has written."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms import BasisNoise, Columns, Term

__all__ = ["checked_columns"]


def checked_columns(
    term: Term, setting: Setting, hyper: Collection[str]
) -> tuple[Columns | BasisNoise, ...]:
    """Return the columns of a nuisance term for the tests of a campaign, and check them.

    Parameters
    ----------
    term : the nuisance term.
    setting : conditions of the tests.
    hyper : names of the hyper-parameters that the terms of the model have.

    Raises
    ------
    InputError
        If the term returns something else than columns, columns of another number of tests, a
        coefficient twice, or columns whose sd is counted in a hyper-parameter that no term has.
    """
    name = type(term).__name__
    columns = term.columns(setting)
    if not isinstance(columns, tuple | list):
        raise InputError(
            f"columns of {name} must return a tuple of Columns, got {type(columns).__name__}."
            " With a single one, put a comma behind it: return (lb.terms.Columns(…),)"
        )
    names: set[str] = set()
    for block in columns:
        if isinstance(block, Columns):
            _check_block(name, block, setting.tests, names)
            names.update(block.names)
        _check_scales(name, _hyper_of(block), hyper)
    return tuple(columns)


def _check_block(name: str, block: Columns, tests: int, earlier: Collection[str]) -> None:
    """Raise an `InputError` if a block of columns has other tests, or a name of an earlier block.

    ``name`` is the name of the term, ``tests`` the number of tests in the campaign, and ``earlier``
    the names of the coefficients in earlier blocks of the term.
    """
    require(
        len(block.values) == tests,
        f"columns of {name} must have values of shape ({tests}, {block.values.shape[1]},"
        f" {block.values.shape[2]}), got {block.values.shape}: one for each test of the campaign.",
    )
    twice = [coefficient for coefficient in block.names if coefficient in earlier]
    require(
        not twice,
        f"coefficients of {name} must have different names, got {', '.join(twice)} twice. Rename"
        " them.",
    )


def _hyper_of(block: Columns | BasisNoise) -> Iterable[str]:
    """Return the names of the hyper-parameters in which the sd of a block is counted."""
    if isinstance(block, BasisNoise):
        return [block.hyper]
    return [hyper for hyper in (block.hyper, block.decay) if hyper is not None]


def _check_scales(name: str, wanted: Iterable[str], hyper: Collection[str]) -> None:
    """Raise an `InputError` if one of the names ``wanted`` is not in ``hyper``.

    ``name`` is the name of the term, and ``hyper`` the names of the model's hyper-parameters.
    """
    for scale in wanted:
        require(
            scale in hyper,
            f"the sd of columns of {name} must be counted in a scale of the term, got {scale!r},"
            " which is none. Give the term scales with this name, or leave the scale out where the"
            " sd is in mm.",
        )
