"""Running torque: no-load torque and friction against speed, and the empty shafts' own."""
