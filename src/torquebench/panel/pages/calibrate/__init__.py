"""The calibration workflow: mount, measure, compare models, verify, sign."""
