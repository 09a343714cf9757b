"""The evidence by quadrature against nested sampling (dynesty, extra `bench`).

python studies/90_speed/evidence.py            # fails when they differ by more than three of nested sampling's errors
python studies/90_speed/evidence.py --write    # and keeps evidence.json
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from peers import nested_log_evidence

import ldbb_bayes as lb

HERE = Path(__file__).parent


def main() -> None:
    """Constant and linear compliance, without and with truncation, over all parameters and over the hyper-parameters alone."""
    campaign = lb.read_campaign(HERE.parents[1] / "data" / "recovered_experiment")
    rows = []
    for degree in (0, 1):
        full = lb.HybridModel.default(degree)
        for truncation, model in (("off", full.without("truncation")), ("on", full)):
            exact = lb.log_evidence(model, campaign)
            for over in ("all", "hyper") if truncation == "off" else ("all",):
                value, error = nested_log_evidence(model.bind(campaign), seed=3, over=over)
                row = {"degree": degree, "truncation": truncation, "over": over, "nested": value, "error": error}
                rows.append(row | {"quadrature": exact.log_value, "apart": abs(value - exact.log_value) / error})
                print(row, flush=True)
    if "--write" in sys.argv[1:]:
        (HERE / "evidence.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    if max(row["apart"] for row in rows) > 3.0:
        sys.exit("The two disagree.")


if __name__ == "__main__":
    main()
