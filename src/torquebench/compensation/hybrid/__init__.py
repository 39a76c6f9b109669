"""The recommended model: the chain's physics, a Gaussian process, and structured effects.

`model` has the estimator; the other modules are its parts: `effects` and `drift` say what a chain
may show, `correlated_scatter` what repeats say of the noise, `inference` and `averaging` find the
posterior for one setting, `search` averages over settings, `posterior_variance` gives the curve's.
"""

from torquebench.compensation.hybrid.model import HybridModel

__all__ = ["HybridModel"]
