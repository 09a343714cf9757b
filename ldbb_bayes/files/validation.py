"""Validation of input files and arguments; an `InputError` names the invalid entry."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache, wraps
from typing import Any, Literal, NamedTuple, TypeVar, cast, get_args, get_origin

from pydantic import TypeAdapter, ValidationError

from ldbb_bayes.errors import InputError, require, suggestion

__all__ = ["raises_input_error", "validated"]

T = TypeVar("T")
# Types of errors with which pydantic, the library that checks input, reports unknown keys.
_UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")
# Beginning of most error messages of pydantic, the library that checks input.
_EXPECTATION = "Input should be "


@cache
def _adapter(model: type[Any]) -> TypeAdapter[Any]:
    """Return the pydantic object that checks whether the content of a file is valid.

    ``model`` is the class that describes valid content. The object is kept for later calls with the
    same class, because it takes milliseconds to make.
    """
    return TypeAdapter(model)


def validated(
    model: type[T],
    content: dict[str, Any],
    place: str,
    flags: Mapping[str, str] | None = None,
) -> T:
    """Check the content of a file, and return it as an object of the class ``model``.

    Parameters
    ----------
    model
        Class that describes valid content: a model or dataclass of the library pydantic.
    content
        Content of the file.
    place
        Name of the file, for the message of an `InputError`.
    flags
        Flags of the command-line options that set the entries, such as ``--unit``; the keys are the
        names of the entries. The message names such an entry by its flag alone. Default: no entry
        was set by an option.

    Returns
    -------
    T
        The validated content.

    Raises
    ------
    InputError
        For invalid content. The message names the file and the first fault. An unknown key is
        reported before missing keys; the message suggests the most similar valid key.
    """
    try:
        return cast("T", _adapter(cast("Any", model)).validate_python(content))
    except ValidationError as error:
        errors = error.errors()
    unknown_keys = [entry for entry in errors if entry["type"] in _UNKNOWN_KEY]
    first = (unknown_keys or errors)[0]
    location = _locate(model, content, first["loc"])
    cause = first.get("ctx", {}).get("error")
    # The error that pydantic reports concerns the content of the file as a whole, not one entry.
    if not location.keys:
        reason = _describe_invalid("content", first)
        if isinstance(cause, InputError):
            reason = str(cause)
        raise InputError(f"{place}: {reason}")
    if isinstance(cause, InputError):
        raise InputError(f"{place}, [{' '.join(location.keys)}]: {cause}")
    *tables, key = location.keys
    table = f" in [{' '.join(tables)}]" if tables else ""
    if unknown_keys:
        model_fields = location.owner.__pydantic_fields__
        known = [field.alias or name for name, field in model_fields.items()]
        raise InputError(
            f"{place}: keys{table} must be among {', '.join(known)}, got {key!r}."
            f"{suggestion(key, known)}"
        )
    require(
        first["type"] != "missing",
        f"{place}: {key!r}{table} must be given, found none. Add {_entry_to_add(location)}.",
    )
    subject = f"{place}: {key!r}{table}"
    if flags is not None:
        subject = flags.get(" ".join(location.keys), subject)
    raise InputError(_describe_invalid(subject, first))


class _Location(NamedTuple):
    """Place of an invalid entry in the content of a TOML file."""

    # keys of a TOML file that lead from the outermost table to an invalid entry; entries of lists
    # are numbered from 1
    keys: list[str]
    # pydantic class that describes the valid content of the innermost table on the path ``keys``
    owner: Any


def _entry_to_add(location: _Location) -> str:
    """Return the line that adds a missing entry to a TOML file, or "it" if its value is not known.

    The value is known if only one value is valid, as in ``schema = 1``.
    """
    key = location.keys[-1]
    for name, field in location.owner.__pydantic_fields__.items():
        if key in (name, field.alias) and get_origin(field.annotation) is Literal:
            values = get_args(field.annotation)
            if len(values) == 1:
                return f"{key} = {values[0]}"
    return "it"


def _locate(model: Any, content: Any, loc: tuple[int | str, ...]) -> _Location:
    """Return the place in a file at which pydantic has found an error.

    The place consists of the keys that lead to the invalid entry; positions in lists are counted
    from 1. The result also holds the class that describes the innermost table to which the keys
    lead.

    Parameters
    ----------
    model
        Class of the library pydantic that describes valid content.
    content
        Content of the file.
    loc
        Location of the error as pydantic reports it: keys, positions in lists (counted from 0), and
        names of types.
    """
    keys: list[str] = []
    owner = model
    for key in loc:
        if not isinstance(content, dict | list):
            # The location of an error, as pydantic reports it, may end with names of types, which
            # are not keys of the TOML file.
            break
        keys.append(str(key + 1) if isinstance(key, int) else key)
        entries = dict(enumerate(content)) if isinstance(content, list) else content
        content = entries.get(key)
        owner = _nested_model(owner, key)
    return _Location(keys, owner)


def _nested_model(owner: Any, key: int | str) -> Any:
    """Return the pydantic class that describes the table under the key ``key`` of a TOML file.

    ``owner`` is the class that describes the table in which the key occurs. If the value of the key
    is not a table, return ``owner``.
    """
    for name, field in owner.__pydantic_fields__.items():
        if key not in (name, field.alias):
            continue
        for kind in (field.annotation, *get_args(field.annotation)):
            if hasattr(kind, "__pydantic_fields__"):
                return kind
    return owner


def _describe_invalid(subject: str, error: Any) -> str:
    """Return the error message for an invalid value in a file or argument.

    ``subject`` names the value in the message. ``error`` describes the fault: it is one entry of
    the list of errors that pydantic, the library that checks input, has found.
    """
    message = error["msg"].removeprefix("Value error, ")
    message = re.sub(r"dictionary or an instance of _\w+", "table", message)
    message = re.sub(r"a valid boolean(, unable to interpret input)?", "true or false", message)
    value = error["input"]
    if error["type"] == "sequence_str" or message.endswith("instance of Sequence"):
        return f"{subject} must be a list, got {value!r}. Write it in brackets: [...]."
    if message.startswith(_EXPECTATION):
        expected = message.removeprefix(_EXPECTATION)
        return f"{subject} must be {expected}, got {value!r}. Correct it."
    reason = message[0].lower() + message[1:]
    return f"{subject} must be valid, got {value!r}: {reason}. Correct it."


def raises_input_error(
    subject: str, advice: Mapping[str, str] | None = None
) -> Callable[[type[T]], type[T]]:
    """Return a decorator that makes a class raise an `InputError` for wrong arguments.

    The class is a dataclass of the library pydantic, which otherwise raises a `ValidationError`
    with a message of several lines. The decorator must wrap ``__init__``, because pydantic itself
    writes this method and turns every error in it into a `ValidationError`. A base class could not
    replace the method.

    Parameters
    ----------
    subject
        Name of the object in the error message, such as "test".
    advice
        Further advice for a wrong argument; the keys are the names of the arguments.
    """

    def decorate(cls: type[T]) -> type[T]:
        """Make the dataclass ``cls`` raise an `InputError` for wrong arguments, and return it."""
        pydantic_init = cls.__init__

        @wraps(pydantic_init)
        def checked_init(self: T, *args: Any, **kwargs: Any) -> None:
            """Create an object of the dataclass; raise an `InputError` for wrong arguments."""
            try:
                pydantic_init(self, *args, **kwargs)
            except ValidationError as error:
                raise _input_error(cls, subject, kwargs, error, advice or {}) from None

        cls.__init__ = checked_init  # type: ignore[method-assign, assignment]
        return cls

    return decorate


def _input_error(
    cls: type,
    subject: str,
    kwargs: dict[str, Any],
    error: ValidationError,
    advice: Mapping[str, str],
) -> InputError:
    """Return the `InputError` for a wrong argument of a class.

    Parameters
    ----------
    cls
        The class, a dataclass of pydantic (the library that checks input).
    subject
        Name of the object in the message, such as "test".
    kwargs
        Keyword arguments with which the class was called.
    error
        Error that pydantic raised.
    advice
        Further advice for a wrong argument; the keys are the names of the arguments.
    """
    first = error.errors()[0]
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return cause
    place = subject
    if kwargs.get("name"):
        place = f"{subject} {kwargs['name']!r}"
    # The error that pydantic reports concerns several arguments of the class together, not one.
    if not first["loc"]:
        return InputError(f"{place}: {_describe_invalid('arguments', first)}")
    key = first["loc"][0]
    dataclass_fields = vars(cls)["__dataclass_fields__"]
    if first["type"] in _UNKNOWN_KEY:
        known = [name for name, field in dataclass_fields.items() if field.init]
        return InputError(
            f"{place}: arguments must be among {', '.join(known)}, got {key!r}."
            f"{suggestion(str(key), known)}"
        )
    if isinstance(key, int):
        positional = [
            name for name, field in dataclass_fields.items() if field.init and not field.kw_only
        ]
        key = positional[key]
    further = f" {advice[key]}" if key in advice else ""
    return InputError(f"{place}: {_describe_invalid(key, first)}{further}")
