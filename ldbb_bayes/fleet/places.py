"""A disk or mount that fails is told apart from a campaign that cannot be fitted."""

from __future__ import annotations

import errno
import os

from ldbb_bayes.errors import InputError

__all__ = ["refuse_sick_places"]

# What no campaign causes: a full or failing disk, a mount that went, a system that opens no more files.
_NAMES = ("ENOSPC", "EDQUOT", "EIO", "ESTALE", "ENODEV", "ENOTCONN", "ETIMEDOUT", "EMFILE", "ENFILE")
_SICK = {getattr(errno, name) for name in _NAMES if hasattr(errno, name)}


def refuse_sick_places(error: BaseException, place: str) -> None:
    """End the batch where it is the disk, not the campaign: else every campaign left would count as failed.

    Parameters
    ----------
    error : BaseException
        What went wrong; so is looked through what it came from.
    place : str
        The campaign.

    Raises
    ------
    InputError
        When the place is to blame.
    """
    chain: list[BaseException] = [error]
    while (before := chain[-1].__cause__ or chain[-1].__context__) is not None and before not in chain:
        chain.append(before)
    try:
        os.stat(place)  # of a mount that went, exists() and the like only say that nothing is there
    except (OSError, ValueError) as gone:
        chain.append(gone)
    for each in chain:
        if isinstance(each, OSError) and each.errno in _SICK:
            raise InputError(
                f"{each.filename or place} must be usable, got: {each.strerror}. That is the place, not the campaign: mend it "
                "(or remove this file, if it alone is lost), then go on with --resume. What is done is kept."
            ) from None
