"""Running torque: no-load torque and friction against speed, and empty runs."""
