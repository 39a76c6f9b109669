"""The live page and its chart."""
