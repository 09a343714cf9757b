"""Error for a question that the user must answer by choosing one of a few possible values."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.errors import InputError

__all__ = ["OpenQuestionError"]


class OpenQuestionError(InputError):
    """Error for a question that the user must answer, because a file can be read in several ways.

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

        ``message`` is the text of the error, ``field`` is the field of the layout that the user
        must set, and ``answers`` are the possible values of this field.
        """
        super().__init__(message)
        self.field = field
        self.answers = tuple(answers)
