"""What was aimed at, what was measured, and whether the aim is reached."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from timed_campaigns import TOLERANCE

__all__ = ["aims"]

AIM_OF_INDEPENDENT = 4.0
AIM_OF_JOINT = 1.0
AIM_OF_DRAWS = 20_000.0
AIM_OF_KERNEL_US = 6.0
AIM_OF_CONDITIONAL = 4.0


def aims(results: dict[str, Any]) -> list[dict[str, Any]]:
    """All rows of the table of aims."""
    return [
        *aims_of_samplers(results["race"]),
        *aims_of_kernel(results["kernel"]),
        *aims_of_campaigns(results["campaigns"]),
    ]


def at_least(quantity: str, aim: float, unit: str, value: float) -> dict[str, Any]:
    """A row whose value is to be large."""
    return {
        "what": quantity,
        "aim": f"≥ {aim:,g} {unit}".strip(),
        "found": value,
        "reached": value >= aim,
    }


def at_most(quantity: str, aim: float, unit: str, value: float) -> dict[str, Any]:
    """A row whose value is to be small."""
    return {
        "what": quantity,
        "aim": f"≤ {aim:g} {unit}".strip(),
        "found": value,
        "reached": value <= aim,
    }


def none_of(quantity: str, exceptions: list[str]) -> dict[str, Any]:
    """A row that counts what should not be."""
    return {"what": quantity, "aim": "0", "found": len(exceptions), "reached": not exceptions}


def aims_of_samplers(rows: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The race on the recovered experiment."""
    draws = "effective draws per CPU second"
    return [
        at_least(
            "independent draws against the best NUTS, per CPU second",
            AIM_OF_INDEPENDENT,
            "times",
            rows["independent"]["cpu_ratio"]["median"],
        ),
        at_least(
            "`joint` against the best NUTS, per CPU second",
            AIM_OF_JOINT,
            "times",
            rows["joint"]["cpu_ratio"]["median"],
        ),
        at_least(
            f"`independent` with truncation, {draws}",
            AIM_OF_DRAWS,
            "",
            rows["independent, truncated"]["per_cpu"]["median"],
        ),
        at_least(
            f"`joint` with truncation, {draws}",
            AIM_OF_DRAWS,
            "",
            rows["joint, truncated"]["per_cpu"]["median"],
        ),
    ]


def aims_of_kernel(kernels: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The kernel on the recovered experiment, and how it grows with the number of circles."""
    per_phi_us = {
        int(name): row["evidence"]["median"] for name, row in kernels.items() if name != "recovered"
    }
    fewest = min(per_phi_us)
    growths = []
    for circles, time_us in per_phi_us.items():
        if circles != fewest:
            growths.append(time_us / per_phi_us[fewest] / (circles / fewest))
    return [
        at_most(
            "kernel on the recovered experiment, µs for each φ",
            AIM_OF_KERNEL_US,
            "",
            kernels["recovered"]["evidence"]["median"],
        ),
        at_most(
            f"kernel's growth up to {max(per_phi_us)} circles over that of their number",
            1.0,
            "",
            max(growths),
        ),
    ]


def aims_of_campaigns(rows: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Campaigns of the default model."""
    ratios = [row["conditional_us"] / row["density_us"] for row in rows.values()]
    late = [name for name, row in rows.items() if row["evidence_s"] > row["asked_s"]]
    inexact = [name for name, row in rows.items() if row["error"] > TOLERANCE]
    return [
        at_most(
            "p(β given y, φ) over ln p(y given φ), largest of all kinds of campaigns",
            AIM_OF_CONDITIONAL,
            "times",
            max(ratios),
        ),
        none_of("kinds of campaigns whose evidence takes longer than asked", late),
        none_of(f"kinds of campaigns whose evidence has an error above {TOLERANCE:g} nat", inexact),
    ]
