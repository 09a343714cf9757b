"""Public names of `lb.analysis`; each is imported when it is first asked for."""

from .budgets import budget_uncertainty as budget_uncertainty
from .calibration import Validation as Validation
from .circularity import predict_circularity as predict_circularity
from .comparison import Comparison as Comparison
from .comparison import read_comparison as read_comparison
from .compliance_change import ChangeWithForce as ChangeWithForce
from .compliance_change import change_with_force as change_with_force
from .conformity import Conformity as Conformity
from .design import Design as Design
from .design import forecast_plan as forecast_plan
from .design import read_design as read_design
from .differences import compare_posteriors as compare_posteriors
from .directional_stiffness import DirectionalStiffness as DirectionalStiffness
from .directional_stiffness import PlaneStiffness as PlaneStiffness
from .gum_validation import GumComparison as GumComparison
from .gum_validation import GumValidation as GumValidation
from .gum_validation import validate_gum as validate_gum
from .measured_paths import measure_circularity as measure_circularity
from .path_contributions import decompose_deviation as decompose_deviation
from .posterior_calibration import calibrate_posterior as calibrate_posterior
from .tolerances import Tolerance as Tolerance
from .verdicts import Identifiability as Identifiability
from .verdicts import ParameterIdentifiability as ParameterIdentifiability
from .verdicts import judge_posterior as judge_posterior
from .workflow import Workflow as Workflow
from .workflow import check_workflow as check_workflow
