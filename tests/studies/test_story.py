"""The six lines of the project's README say what the studies found, and link to them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def test_six_lines(root: Path) -> None:
    text = (root / "README.md").read_text(encoding="utf-8").split("## The paper, re-examined")[1].split("\n## ")[0]
    lines = [line for line in text.splitlines() if line[:2] in {f"{n}." for n in range(1, 10)}]
    assert len(lines) == 6
    assert "](studies/README.md)" in text

    def results(name: str) -> dict[str, Any]:
        return dict(json.loads((root / "studies" / name / "results.json").read_text(encoding="utf-8")))

    def minus(value: str) -> str:
        return value.replace("-", "−")

    first, second, third, fourth = (
        results(n) for n in ("01_simulation", "02_recovered_experiment", "03_confounding", "04_constant_or_linear")
    )
    assert len(first["table_4"]["misprinted"]) == 1
    ccy = second["completions"]["range"]["C_CCY"]
    gain, scale = third["parameters"]["E_XX1"], fourth["compared"]
    alone, lightest = fourth["printed"]["log_bayes_factor"], fourth["printed"]["without"]["36"]
    assumed = {name: entry["log_bayes_factor"] for name, entry in scale["assumptions"].items()}
    rmse = scale["least_squares_rmse_um"]
    fifth, sixth = results("05_next_campaign"), results("06_validation")
    right = [share for kind in sixth["calibrated"] for share in sixth["cases"][kind]["coverage"].values()]
    claims = [
        (
            f"in {first['table_4']['same']} of 13 estimates",
            f"a {first['table_4']['step_deg']:.0f}° step",
            f"up to {first['reach']['limit_in_prior_sd']:.1f} times",
        ),
        (
            f"{second['printed_numbers']} printed numbers",
            f"but for {second['open']['count']} of {second['dimensions']} directions",
            f"C_CCY is {ccy[0] * 1e9:.2f} or {ccy[1] * 1e9:.1f} µrad/(N m)",
        ),
        (
            minus(f"{gain['least squares']['mean']:.2f} ± {gain['least squares']['sd']:.2f}"),
            minus(f"{gain['with form']['mean']:.0f} ± {gain['with form']['sd']:.0f}"),
            minus(f"prints E_XX1 = {gain['published']:.0f} µm/m"),
        ),
        (
            f"falls by {100 * (1 - rmse['linear'] / rmse['constant']):.0f} %",
            f"ln B = {assumed['white noise only, no truncation']:+.0f}",
            f"printed numbers themselves say {alone['zero and centre move']:+.1f}",
            f"({alone['the centre alone moves']:+.0f} if the bar's zero stays)",
            minus(f"recovered readings {scale['log_bayes_factor']:.1f}"),
            f"probability {fourth['printed']['inclusion']['C_XYX']:.4f}",
            f"but {lightest['inclusion']['C_XYX']:.2f} without the circle at 36 N",
            minus(f"ln B is then {lightest['log_bayes_factor']:.1f} ({lightest['the centre alone moves']:.1f})"),
        ),
        (f"{fifth['settling']['tests']['number']} circles at three forces",),
        (
            f"cover {100 * min(right):.0f} to {100 * max(right):.0f} %",
            f"as little as {100 * sixth['cases']['no discrepancy']['worst_coverage']:.0f}",
            f"({100 * sixth['cases']['no discrepancy, more readings']['worst_coverage']:.0f} with four times the readings)",
        ),
    ]
    for line, own in zip(lines, claims, strict=True):
        for claim in own:
            assert claim in line, claim
        assert "](studies/0" in line
