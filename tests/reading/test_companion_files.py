"""Files without readings among the files of a campaign."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def circle(folder: Path, force_N: int) -> Path:
    """Write the file of one circle and return its path."""
    lines = ["Angle [deg],Reading [um]"]
    for angle_deg in range(0, 360, 10):
        lines.append(f"{angle_deg},{0.02 * force_N + angle_deg % 30 / 100}")
    path = folder / f"{force_N}N.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


def test_an_empty_companion_is_told_once_to_be_left_out(tmp_path: Path) -> None:
    empty = tmp_path / "notes.csv"
    empty.touch()
    with pytest.raises(lb.InputError) as refusal:
        lb.import_campaign([circle(tmp_path, 100), circle(tmp_path, 300), empty])
    assert str(refusal.value).endswith("got an empty file. Leave it out or export it again.")


@pytest.mark.parametrize("beginning", [b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0", b"II*\x00"])
def test_a_picture_alone_is_called_a_picture(beginning: bytes, tmp_path: Path) -> None:
    path = tmp_path / "photo.bin"
    path.write_bytes(beginning + bytes(range(256)))
    with pytest.raises(lb.InputError, match="got a document or a picture"):
        lb.import_campaign(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_text_named_as_a_workbook_is_read(encoding: str, tmp_path: Path) -> None:
    text = circle(tmp_path, 100).read_text().replace(",", "\t")
    path = tmp_path / "100N.xls"
    path.write_bytes(text.encode(encoding))
    assert lb.import_campaign(path).campaign.tests[0].reading_um[:2].tolist() == [2.0, 2.1]
