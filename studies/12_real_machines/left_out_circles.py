"""Whether circles look like what the other circles of their campaign predict: how often the checks
of `check_workflow` alarm where nothing is wrong, and where something is.

Every circle is left out in turn and compared with circles that the others predict, under constant
and linear compliance weighted by their posterior probabilities. Its p-value is uniform if the model
holds. Two checks are made of the p-values of one campaign:

    one circle   the smallest of them, adjusted for their number (Holm)
    together     whether all of them are uniform, however they depend on one another
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from machines import FAMILIES, FORCES_N, simulate
from study import Effort, replicated

import ldbb_bayes as lb
from ldbb_bayes.analysis.multiple_testing import uniformity_p_value
from ldbb_bayes.analysis.outlying_tests import FALSE_ALARMS, judge_tests
from ldbb_bayes.inference.evidences import Evidences, leave_one_out

__all__ = ["SOUND", "alarms_by_kind", "campaign_of", "left_out_circles", "p_values"]

HERE = Path(__file__).resolve().parent

# Kind of the campaigns that are simulated by the model itself, in which nothing is wrong.
SOUND = "as the model says"
# Number of campaigns of every family of machines, and of the mild family, whose alarms are false.
OF_A_FAMILY = 30
OF_THE_MILD = 200
# Number of campaigns of every kind.
KINDS = {SOUND: 500, **dict.fromkeys(FAMILIES, OF_A_FAMILY), "mild": OF_THE_MILD}
# Number of campaigns of every kind that are made again when the study is run.
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 3}
# Forces of the circles of a sound campaign [N]: fewer than those of the families, for 500 campaigns
# take long.
SOUND_FORCES_N = FORCES_N[::2]
# Readings of every circle of a sound campaign. More change nothing: each circle is reduced to its
# Fourier coefficients.
SOUND_READINGS = 72
# Number of simulated circles with which every circle is compared at first.
REPLICATES = 2000
# Error allowed in every log evidence [nat].
TOLERANCE = 0.1
# A p-value of all circles together below this is an alarm.
ALARM = 0.05
CONSTANT = lb.HybridModel.default(0)
LINEAR = lb.HybridModel.default(1)


def left_out_circles(effort: Effort) -> dict[str, Any]:
    """Return what the page states of circles left out."""
    rows = replicated(HERE / "left_out.csv", p_values, KINDS, effort, again=AGAIN)
    return {
        "circles": len(SOUND_FORCES_N),
        "replicates": REPLICATES,
        "level_of_one": FALSE_ALARMS,
        "level_together": ALARM,
        "alarms": alarms_by_kind(rows),
    }


def p_values(kind: str, seed: int) -> dict[str, float]:
    """Return the p-values of both checks in one campaign."""
    campaign = campaign_of(kind, seed)
    evidences = Evidences(campaign, tolerance=TOLERANCE)
    nodes = dict(zip(("constant", "linear"), evidences.nodes(CONSTANT, LINEAR), strict=True))
    without_one = leave_one_out(nodes, tolerance=TOLERANCE)
    judged = judge_tests(
        nodes, without_one, seed=seed, tolerance=TOLERANCE, replicates=REPLICATES
    ).values()
    single = np.array([test.p_value for test in judged])
    return {
        "one circle": min(test.family_wise_p_value for test in judged),
        "together": float(uniformity_p_value(single)),
    }


def campaign_of(kind: str, seed: int) -> lb.Campaign:
    """Return a simulated campaign.

    The truth of a sound one is drawn from the prior of constant compliance (even seeds) or of
    linear compliance (odd seeds), which have equal probabilities.
    """
    if kind != SOUND:
        return simulate(FAMILIES[kind], seed)[0]
    angle = np.arange(SOUND_READINGS) * 360.0 / SOUND_READINGS
    tests = tuple(lb.CircularTest(force, angle, direction="CW") for force in SOUND_FORCES_N)
    model = (CONSTANT, LINEAR)[seed % 2]
    return model.simulate(lb.Campaign(tests), seed=seed).campaign


def alarms_by_kind(rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Return by kind the number of campaigns and the share in which each check alarms."""
    alarms = {}
    for kind, of_kind in rows.groupby("kind", sort=False):
        alarm_rate = float((of_kind["together"] < ALARM).mean())
        alarms[str(kind)] = {
            "campaigns": len(of_kind),
            "one_circle": float((of_kind["one circle"] < FALSE_ALARMS).mean()),
            "together": alarm_rate,
            "together_se": float(np.sqrt(alarm_rate * (1.0 - alarm_rate) / len(of_kind))),
        }
    return alarms
