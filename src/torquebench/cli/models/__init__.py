"""Commands on models: fit, apply, verify, export, budget."""
