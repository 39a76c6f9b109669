"""Torque-angle loops: stiffness, backlash, lost motion and hysteresis loss."""
