"""Public names of `lb.inference`; each is imported when it is first asked for."""

from .cross_validation import with_predictive as with_predictive
from .density import LogDensity as LogDensity
from .evidence import log_bayes_factor as log_bayes_factor
from .evidences import Evidences as Evidences
from .least_squares import LeastSquares as LeastSquares
from .mcmc import StoppingRule as StoppingRule
from .quadrature_marginals import marginalize as marginalize
from .summary import summarize_nuisances as summarize_nuisances
