"""Efficiency over torque and speed."""
