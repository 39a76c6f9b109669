"""The recommended model: the chain's physics, a Gaussian process, and structured effects.

`model` has the estimator. Its parts: `effects` and `drift` describe what a chain may show,
`correlated_scatter` estimates noise from repeats, `inference` and `averaging` find the posterior
for one setting, `search` averages over settings, `posterior_variance` computes the curve's
variance.
"""

from torquebench.compensation.hybrid.model import HybridModel

__all__ = ["HybridModel"]
