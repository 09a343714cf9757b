"""Public names of `lb.fleet`; each is imported when it is first asked for."""

from .batch import Batch as Batch
from .batch import run_batch as run_batch
from .control_chart import draw_control_chart as draw_control_chart
from .dataset import read_batch as read_batch
from .pooling import fit_population as fit_population
from .population import Population as Population
from .population_prior import PopulationPrior as PopulationPrior
from .population_prior import read_population_prior as read_population_prior
from .trend import Trend as Trend
from .trend_estimation import find_trend as find_trend
