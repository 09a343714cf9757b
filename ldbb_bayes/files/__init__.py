"""Reading and writing of files and folders, reading of TOML and XML, and validation of input."""

from ldbb_bayes.files.content import LARGEST_TABLE_BYTES, bytes_of, write_whole
from ldbb_bayes.files.staging import check_target, staged_folder
from ldbb_bayes.files.toml_text import LARGEST_TOML_BYTES, parse_toml, read_toml
from ldbb_bayes.files.validation import raises_input_error, validated
from ldbb_bayes.files.xml_text import xml_of

__all__ = [
    "LARGEST_TABLE_BYTES",
    "LARGEST_TOML_BYTES",
    "bytes_of",
    "check_target",
    "parse_toml",
    "raises_input_error",
    "read_toml",
    "staged_folder",
    "validated",
    "write_whole",
    "xml_of",
]
