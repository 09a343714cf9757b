"""What a terminal or a file without certain characters shows instead of them."""

from __future__ import annotations

import io

import pytest

from ldbb_bayes.cli.missing_characters import replace_missing_characters


def written(text: str, encoding: str) -> str:
    """Return a text as a stream in an encoding holds it."""
    stored = io.BytesIO()
    stream = io.TextIOWrapper(stored, encoding=encoding, newline="")
    replace_missing_characters(stream)
    stream.write(text)
    stream.flush()
    return stored.getvalue().decode(encoding)


@pytest.mark.parametrize(
    ("text", "encoding", "expected"),
    [
        ("U = −0.0323 µm", "cp1252", "U = -0.0323 µm"),
        ("U = −0.0323 µm", "ascii", "U = -0.0323 um"),
        ("σ, λ and ΔC at 90°", "cp1252", "sigma, lambda and DeltaC at 90°"),
        ("2 ± 1 at 10⁻³ ≤ x", "ascii", "2 +/- 1 at 10^-3 <= x"),
        ("3.1·10⁻⁵ and 3.1·10⁵", "cp1252", "3.1·10^-5 and 3.1·10^5"),
        ("3.1·10⁻¹² µm/m²", "ascii", "3.1*10^-12 um/m^2"),
        ("⁵", "ascii", "^5"),
        ("ϑ, ώ, Ά", "cp1252", "theta, omega, Alpha"),
        ("C₀ → Ĉ … äöüß", "ascii", "C0 -> C ... aouss"),
        ("測定", "cp1252", "??"),
        ("−5 bis 3 µm", "utf-8", "−5 bis 3 µm"),
    ],
)
def test_characters_that_are_missing(text: str, encoding: str, expected: str) -> None:
    assert written(text, encoding) == expected
