"""Names of binary formats of other programs, found from the first bytes of a file."""

from __future__ import annotations

__all__ = ["binary_format_of"]

# Name of each format, with the first bytes of its files.
_NAMES = {
    b"TDSm": "a TDMS file of LabVIEW",
    b"\x89HDF\r\n\x1a\n": "an HDF5 file",
    b"\x93NUMPY": "an array of NumPy",
    b"MATLAB 5.0 MAT-file": "a MAT file of MATLAB",
    b"MATLAB 7.3 MAT-file": "a MAT file of MATLAB",
    b"PAR1": "a Parquet file",
    b"SQLite format 3": "an SQLite database",
}


def binary_format_of(raw: bytes) -> str:
    """Return the name of the binary format of a file; empty for text and for other formats.

    Parameters
    ----------
    raw
        Content of the file.
    """
    for beginning, name in _NAMES.items():
        if raw.startswith(beginning):
            return name
    return ""
