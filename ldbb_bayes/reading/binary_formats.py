"""Names of binary formats of other programs, found from the first bytes of a file."""

from __future__ import annotations

from pathlib import Path

from ldbb_bayes.errors import InputError

__all__ = ["check_is_no_binary_format"]

# Name of each format, with the first bytes of its files.
_NAMES = {
    b"TDSm": "a TDMS file of LabVIEW",
    b"\x89HDF\r\n\x1a\n": "an HDF5 file",
    b"\x93NUMPY": "an array of NumPy",
    b"MATLAB 5.0 MAT-file": "a MAT file of MATLAB",
    b"MATLAB 7.3 MAT-file": "a MAT file of MATLAB",
    b"PAR1": "a Parquet file",
    b"SQLite format 3": "an SQLite database",
    b"ARROW1": "a Feather file",
    b"\x80\x04\x95": "a pickle of Python",
    b"\x80\x05\x95": "a pickle of Python",
}


def check_is_no_binary_format(path: Path, raw: bytes) -> None:
    """Raise an error if a file is in a binary format that cannot be imported.

    Parameters
    ----------
    path
        Path of the file for the error message.
    raw
        Content of the file.

    Raises
    ------
    InputError
        If the file begins as files of one of these formats do.
    """
    for beginning, name in _NAMES.items():
        if raw.startswith(beginning):
            raise InputError(
                f"{path} must be a text or a workbook, got {name}. Save the readings as CSV with"
                " the program that wrote it."
            )
