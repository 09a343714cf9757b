"""The nuisance terms of the model, one class for each effect.

Nuisance terms are effects that are modelled but not of interest. In test r, at the angle θ on the
circle, the bar reads ρ_r(θ) = F_r Σ_k (F_r − F0)^k j_C·C_k + j_G·E + N + ε. F_r is the force of the
test and F0 the reference force. C_0 are the compliances and C_1 their slopes (changes with force),
E are the geometric errors, N is the sum of the nuisance terms, and ε is white noise. j_C is the
reading per unit force and compliance, and j_G the reading per unit geometric error.

The class of a term defines the columns (readings per unit coefficient, as Fourier coefficients),
the hyper-parameters that scale the prior sds of the coefficients, the unit of the coefficients and
a description in words. To add a term of your own, derive a class from `Term`.
"""

from ldbb_bayes.model.terms.balls import BallForm, MachinePattern
from ldbb_bayes.model.terms.base import (
    Term,
    Uncertainties,
    Unit,
    uncertainties,
)
from ldbb_bayes.model.terms.circles import (
    CircleScale,
    Discrepancy,
    Drift,
    Hysteresis,
    SetupShift,
)
from ldbb_bayes.model.terms.columns import (
    BasisNoise,
    Columns,
    Scale,
)
from ldbb_bayes.model.terms.instrument import Angle, BarLength, ForceError, Mount
from ldbb_bayes.model.terms.joints import JointLoad, Position

__all__ = [
    "Angle",
    "BallForm",
    "BarLength",
    "BasisNoise",
    "CircleScale",
    "Columns",
    "Discrepancy",
    "Drift",
    "ForceError",
    "Hysteresis",
    "JointLoad",
    "MachinePattern",
    "Mount",
    "Position",
    "Scale",
    "SetupShift",
    "Term",
    "Uncertainties",
    "Unit",
    "uncertainties",
]

# Classes of the package's nuisance terms, in the order in which models, results and model files
# list them.
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
