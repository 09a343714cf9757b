"""Error for a missing fact with only a few possible values, of which the user must choose one."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.errors import InputError

__all__ = ["OpenQuestionError"]


class OpenQuestionError(InputError):
    """Error for files that may be read in several ways, so that the user must choose one of them.

    Parameters
    ----------
    message
        Message, which names the option that answers the question.
    field
        Field of the layout that answers the question, such as reading_unit.
    answers
        Values of the field that are possible.
    """

    def __init__(self, message: str, field: str, answers: Sequence[str]) -> None:
        """Build the error.

        ``message`` is its text, ``field`` the field of the layout that the user must set, and
        ``answers`` are the possible values of this field.
        """
        super().__init__(message)
        self.field = field
        self.answers = tuple(answers)
