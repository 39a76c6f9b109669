from .budget import (
    COVERAGE_PROBABILITY as COVERAGE_PROBABILITY,
    Budget as Budget,
    BudgetLine as BudgetLine,
    Shared as Shared,
    coverage_factor as coverage_factor,
    welch_satterthwaite as welch_satterthwaite,
)
from .certified import (
    CertifiedUncertainty as CertifiedUncertainty,
)
from .decision import (
    Decision as Decision,
    Tolerance as Tolerance,
    Verdict as Verdict,
    conformance_probability as conformance_probability,
    decide as decide,
)
from .distributions import (
    Distribution as Distribution,
    sample as sample,
)
from .propagation import (
    MonteCarloResult as MonteCarloResult,
    Validation as Validation,
    check_by_monte_carlo as check_by_monte_carlo,
    coverage_interval as coverage_interval,
    monte_carlo as monte_carlo,
    numerical_tolerance as numerical_tolerance,
)
from .stating import (
    rounded as rounded,
    stated as stated,
)
