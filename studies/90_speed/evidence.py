"""The evidence by quadrature against nested sampling (dynesty, extra `bench`).

python studies/90_speed/evidence.py     # fails when they differ by more than three of nested sampling's errors
"""

from __future__ import annotations

import sys
from pathlib import Path

from peers import nested_log_evidence

import ldbb_bayes as lb

HERE = Path(__file__).parent


def main() -> None:
    """Constant and linear compliance, without and with truncation, over all parameters and over the hyper-parameters alone."""
    campaign = lb.read_campaign(HERE.parents[1] / "data" / "recovered_experiment")
    apart = []
    print("| degree | truncation | nested sampling over | dynesty | quadrature | difference / error |\n|---|---|---|---|---|---|")
    for degree in (0, 1):
        full = lb.HybridModel.default(degree)
        for label, model in (("off", full.without("truncation")), ("on", full)):
            exact = lb.log_evidence(model, campaign)
            for over in ("all", "hyper") if label == "off" else ("all",):
                value, error = nested_log_evidence(model.bind(campaign), seed=3, over=over)
                apart.append(abs(value - exact.log_value) / error)
                print(
                    f"| {degree} | {label} | {over} | {value:.3f} ± {error:.3f} | {exact.log_value:.4f} | {apart[-1]:.2f} |",
                    flush=True,
                )
    if max(apart) > 3.0:
        sys.exit("The two disagree.")


if __name__ == "__main__":
    main()
