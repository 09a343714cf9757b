"""comparison.json read back."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

import ldbb_bayes as lb
from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.analysis.recorded import recorded
from ldbb_bayes.report.figures import compliance_with_local_fits, evidence
from ldbb_bayes.report.plain import json_text


def record_of(comparison: Comparison) -> dict[str, object]:
    campaign = {"name": comparison.campaign, "sha256": comparison.sha256}
    return {"schema": 1, "campaign": campaign, "seed": 1, **comparison.as_dict()}


def test_there_and_back(compared: Comparison, tmp_path: Path) -> None:
    (tmp_path / "comparison.json").write_text(json_text(record_of(compared)), encoding="utf-8")
    back = lb.read_comparison(tmp_path)
    assert json_text(back.as_dict()) == json_text(compared.as_dict())
    assert back.verdict == compared.verdict
    assert (back.campaign, back.sha256, back.pair) == (compared.campaign, compared.sha256, compared.pair)
    pd.testing.assert_frame_equal(back.local_fits, compared.local_fits, check_dtype=False)
    for draw in (evidence, compliance_with_local_fits):
        draw(back)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"campaign": 3}', "{" * 20, '{"a": ' * 3000, "\x00"])
def test_damaged(text: str, tmp_path: Path) -> None:
    (tmp_path / "comparison.json").write_text(text, encoding="utf-8")
    with pytest.raises(lb.InputError, match=r"comparison.json must be a comparison written by"):
        lb.read_comparison(tmp_path)


def test_a_part_missing(compared: Comparison, tmp_path: Path) -> None:
    record = json.loads(json_text(record_of(compared)))
    del record["models"]["linear"]["rmse_um"]
    (tmp_path / "comparison.json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(lb.InputError, match="rmse_um"):
        lb.read_comparison(tmp_path)
    with pytest.raises(lb.InputError, match=r"must be a folder with comparison\.json"):
        lb.read_comparison(tmp_path / "nothing")


def test_a_design_there_and_back(recovered: lb.Campaign, tmp_path: Path) -> None:
    design = lb.design(lb.HybridModel.default(0), pilot=recovered, tests=4)
    pilot = {"name": recovered.name, "sha256": recovered.sha256}
    (tmp_path / "design.json").write_text(json_text({"schema": 1, "pilot": pilot, **design.as_dict()}), encoding="utf-8")
    assert lb.read_design(tmp_path) == recorded(design)
    (tmp_path / "design.json").write_text('{"pilot": {}}', encoding="utf-8")
    with pytest.raises(lb.InputError, match=r"design\.json must be a design written by"):
        lb.read_design(tmp_path)
