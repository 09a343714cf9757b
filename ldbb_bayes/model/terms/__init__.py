"""The nuisance terms of the model, each one class.

ρ_r(θ) = F_r Σ_k (F_r − F0)^k j_C·C_k + j_G·E + terms + ε. A term says what else changes the
readings: its columns in the circle's basis, its scales, its unit and its words. A term of your own
is one more class derived from `Term`.
"""

from ldbb_bayes.model.terms.balls import BallForm, MachinePattern
from ldbb_bayes.model.terms.base import (
    Term,
    Uncertainties,
    Uncertainty,
    Unit,
    uncertainties,
)
from ldbb_bayes.model.terms.circles import (
    CircleScale,
    Covariate,
    Discrepancy,
    Drift,
    Hysteresis,
    Moves,
    SetupShift,
)
from ldbb_bayes.model.terms.columns import (
    FORM_ORDER,
    NOISE,
    OWN,
    BasisNoise,
    Columns,
    Hyper,
    Law,
    Scale,
    Source,
)
from ldbb_bayes.model.terms.editions import first_edition
from ldbb_bayes.model.terms.instrument import Angle, BarLength, ForceError, Mount
from ldbb_bayes.model.terms.joints import JointLoad, Position

__all__ = [
    "FORM_ORDER",
    "NOISE",
    "OWN",
    "Angle",
    "BallForm",
    "BarLength",
    "BasisNoise",
    "CircleScale",
    "Columns",
    "Covariate",
    "Discrepancy",
    "Drift",
    "ForceError",
    "Hyper",
    "Hysteresis",
    "JointLoad",
    "Law",
    "MachinePattern",
    "Mount",
    "Moves",
    "Position",
    "Scale",
    "SetupShift",
    "Source",
    "Term",
    "Uncertainties",
    "Uncertainty",
    "Unit",
    "first_edition",
    "uncertainties",
]

# The order in which models, results and model files list the terms of the package.
_PACKAGE_TERMS: tuple[type[Term], ...] = (
    BallForm,
    MachinePattern,
    BarLength,
    Mount,
    ForceError,
    JointLoad,
    Position,
    Angle,
    SetupShift,
    Discrepancy,
    CircleScale,
    Hysteresis,
    Drift,
)
Term.kinds = {kind.__name__: kind for kind in _PACKAGE_TERMS}
