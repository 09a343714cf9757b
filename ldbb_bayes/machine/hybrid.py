"""The hybrid Jacobian of one circle (Eq. 28, 33) and the patterns of single parameters (Tables 2 and 3), with named columns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.machine.jacobian import compliance_jacobian, geometric_jacobian, wrench_jacobian
from ldbb_bayes.machine.kept import kept_compliances
from ldbb_bayes.machine.names import geometric_names, wrench_names

__all__ = ["hybrid_jacobian", "patterns"]

Array = NDArray[Any]


def hybrid_jacobian(
    machine: Machine, circle: Circle, angle_rad: Array, force_N: float, *, degree: int = 0, reference_force_N: float = 0.0
) -> pd.DataFrame:
    """Reading per unit of every parameter of the linear hybrid model, J_H of Eq. 28 and 33.

    Column k of a compliance is F (F − F0)^k j_C. Columns are those of this circle alone, named as in results: C_XXX …, C_XXX_1 …,
    then E_XX1 … .

    Parameters
    ----------
    angle_rad : ndarray, shape (n,) [rad]
    force_N : float [N]
    degree : {0, 1, 2}
    reference_force_N : float [N]
        F0; 0 is Eq. 33.

    Returns
    -------
    DataFrame, shape (n, (degree + 1) compliances + geometric errors)
        [mm per inside unit of the parameter]; times the parameters it is the reading in mm.

    Raises
    ------
    InputError
        For another degree.
    """
    if degree not in (0, 1, 2):
        raise InputError(f"degree must be 0, 1 or 2, got {degree}. Choose constant, linear or quadratic compliance.")
    angle = np.asarray(angle_rad, dtype=float)
    kept = kept_compliances(machine, circle).names
    elastic = force_N * compliance_jacobian(machine, circle, angle, kept)
    columns = {
        name.label + (f"_{k}" if k else ""): elastic[:, j] * (force_N - reference_force_N) ** k
        for k in range(degree + 1)
        for j, name in enumerate(kept)
    }
    geometric = geometric_jacobian(machine, circle, angle).T
    columns |= {name.label: own for name, own in zip(geometric_names(machine), geometric, strict=True)}
    return pd.DataFrame(columns)


def patterns(machine: Machine, circle: Circle, angle_rad: Array) -> pd.DataFrame:
    """What one unit of every planar compliance, and of every geometric error, does to the reading (Tables 2 and 3).

    Parameters
    ----------
    angle_rad : ndarray, shape (n,) [rad]

    Returns
    -------
    DataFrame, shape (n, compliances + geometric errors)
        For one plane 18 compliances, null columns included [mm per unit and N], and 7 geometric errors [mm per unit].
    """
    angle = np.asarray(angle_rad, dtype=float)
    names = [*(name.label for name in wrench_names(machine)), *(name.label for name in geometric_names(machine))]
    values = np.hstack([wrench_jacobian(machine, circle, angle), geometric_jacobian(machine, circle, angle)])
    return pd.DataFrame(values, columns=names)
