"""Commands for models: fit, apply, verify, export, budget."""
