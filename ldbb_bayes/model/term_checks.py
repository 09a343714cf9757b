"""Checks of the nuisance terms of a model, whose messages state what to write instead."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.errors import InputError, require, suggestion
from ldbb_bayes.model.parameter_kinds import settings_of_sd
from ldbb_bayes.model.terms import BasisNoise, Columns, Term

__all__ = ["check_coefficient_names", "check_terms"]


def check_terms(terms: Sequence[Term]) -> None:
    """Raise an `InputError` unless each term is an object of a class of its own.

    The class must be a dataclass that is derived from `Term`, and may occur only once.
    """
    for term in terms:
        _check_is_object(term)
    classes = [type(term) for term in terms]
    for term_class in classes:
        require(
            issubclass(term_class, Term) and "__dataclass_fields__" in vars(term_class),
            f"nuisances must be terms, got {term_class.__name__}."
            " Derive its class from Term, under @dataclass(frozen=True).",
        )
        require(
            classes.count(term_class) == 1,
            f"nuisances must differ, got {term_class.__name__} twice. Remove one.",
        )


def check_coefficient_names(kind: type[Term], columns: Sequence[Columns | BasisNoise]) -> None:
    """Raise an `InputError` if a coefficient has a name of a parameter or of another term.

    Results find the unit and the words of a coefficient, and its correlation between campaigns, by
    its name. A name that belongs to no term is allowed if the unit and the correlation that it then
    gets, those of `Term`, are those of the term. A term that is derived from another one may keep
    its names. ``kind`` is the class of the nuisance term, and ``columns`` are its columns.
    """
    owners = [base for base in kind.__mro__ if base is not Term]
    if kind.unit == Term.unit and kind.campaign_correlation == Term.campaign_correlation:
        owners.append(Term)
    for block in columns:
        for name in block.names if isinstance(block, Columns) else ():
            require(
                not settings_of_sd(name),
                f"a coefficient of {kind.__name__} must not be named like a parameter, got"
                f" {name!r}. Let its name begin with the term's stem ({kind.stem!r}).",
            )
            owner = Term.owner(name)
            of_owner = "" if owner is Term else f", a name of {owner.__name__}"
            require(
                owner in owners,
                f"the coefficients of {kind.__name__} must have names that begin with its stem"
                f" ({kind.stem!r}), got {name!r}{of_owner}. Rename them, or set another stem.",
            )


def _check_is_object(term: object) -> None:
    """Raise an `InputError` if ``term`` is the name or the class of a term, and not an object.

    The message states the call that makes the object. For a name that no term has, it lists the
    classes of terms, and suggests the one with the most similar name, if there is one.
    """
    if isinstance(term, str):
        class_by_name: dict[str, type] = dict(Term.kinds)
        for known_class in Term.kinds.values():
            class_by_name[known_class.key()] = known_class
        if term not in class_by_name:
            raise InputError(
                f"a term must be an object of one of the classes {', '.join(Term.kinds)}, got"
                f" {term!r}.{suggestion(term, Term.kinds)} Write for example"
                " lb.terms.BarLength(...), with its settings in the brackets, if any."
            )
        term_text = repr(term)
        term_class = class_by_name[term]
    elif isinstance(term, type) and issubclass(term, Term):
        term_text = f"the class {term.__name__}"
        term_class = term
    else:
        return
    name = term_class.__name__
    if term_class.__module__.startswith("ldbb_bayes."):
        name = f"lb.terms.{name}"
    raise InputError(
        f"a term must be an object, got {term_text}. Write {name}(...), with its settings in the"
        " brackets, if any."
    )
