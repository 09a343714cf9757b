"""The public names of this package; `__init__.py` imports each when it is first used.

Names that most analyses need are listed here; others are in subpackages, such as `lb.terms.Drift`.
"""

from . import analysis as analysis
from . import campaign as campaign
from . import fleet as fleet
from . import inference as inference
from . import machine as machine
from . import reading as reading
from . import report as report
from .analysis.averaging import average as average
from .analysis.calibration import calibrate as calibrate
from .analysis.conformity import assess_conformity as assess_conformity
from .analysis.design import design as design
from .analysis.directional_stiffness import stiffness as stiffness
from .analysis.identification import identify as identify
from .analysis.machine_description import describe_machine as describe_machine
from .analysis.model_comparison import compare as compare
from .analysis.neighbouring_forces import local_fits as local_fits
from .analysis.outlying_tests import find_outlying_tests as find_outlying_tests
from .campaign.campaign import Ball as Ball
from .campaign.campaign import Campaign as Campaign
from .campaign.campaign import CircularTest as CircularTest
from .campaign.campaign import Instrument as Instrument
from .campaign.campaign import Plan as Plan
from .campaign.folder import embedded_campaign as embedded_campaign
from .campaign.folder import read_campaign as read_campaign
from .campaign.folder import write_campaign as write_campaign
from .campaign.preview import check_campaign as check_campaign
from .errors import InputError as InputError
from .inference.density import log_density as log_density
from .inference.evidence import log_evidence as log_evidence
from .inference.least_squares import fit_least_squares as fit_least_squares
from .inference.posterior import to_units as to_units
from .inference.posterior_file import load as load
from .inference.posterior_file import save as save
from .inference.prediction import predict as predict
from .inference.sample import sample as sample
from .inference.summary import summarize as summarize
from .machine.chain import Machine as Machine
from .model import terms as terms
from .model.hybrid import HybridModel as HybridModel
from .model.prior import Prior as Prior
from .model.specification import read_model as read_model
from .reading.importing import import_campaign as import_campaign
from .report import figures as figures
from .report.page import write_report as write_report

__version__: str
