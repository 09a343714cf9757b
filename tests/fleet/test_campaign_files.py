"""The digest of a campaign changes with each of its files, and with nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from ldbb_bayes.fleet.campaign_files import digest_of_files

FILES = {
    "campaign.toml": 'pilot = "pilot"\n[bar]\ndcc = "bar.xml"\n[[test]]\nfile = "f036.csv"\n',
    "bar.xml": "<dcc/>",
    "f036.csv": "angle_deg,reading_um\n0,1\n",
    "pilot/campaign.toml": '[[test]]\nfile = "f742.csv"\n',
    "pilot/f742.csv": "angle_deg,reading_um\n0,3\n",
}


def written(folder: Path) -> Path:
    """Write a campaign with a certificate and a pilot."""
    for name, content in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", FILES)
def test_every_file_counts(name: str, tmp_path: Path) -> None:
    campaign = written(tmp_path)
    before = digest_of_files(str(campaign))
    with (campaign / name).open("a", encoding="utf-8") as file:
        file.write("\n")
    assert digest_of_files(str(campaign)) != before


def test_other_files_do_not_count(tmp_path: Path) -> None:
    campaign = written(tmp_path)
    before = digest_of_files(str(campaign))
    (campaign / "report.html").write_text("report", encoding="utf-8")
    assert digest_of_files(str(campaign)) == before
    assert digest_of_files(str(campaign / "campaign.toml")) == before


def test_a_tidy_table_counts(tmp_path: Path) -> None:
    table = tmp_path / "tidy.csv"
    table.write_text("test,angle_deg,reading_um\n", encoding="utf-8")
    before = digest_of_files(str(table))
    table.write_text("test,angle_deg,reading_mm\n", encoding="utf-8")
    assert digest_of_files(str(table)) != before


@pytest.mark.parametrize("content", [b"[[test]\n", b"\xff", b'pilot = "."', b'file = "\\u0000"'])
def test_a_damaged_campaign_has_a_digest(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_bytes(content)
    assert len(digest_of_files(str(tmp_path))) == 64
