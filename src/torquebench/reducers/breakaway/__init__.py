"""Starting and back-driving torque: the first motion under a slow ramp of torque."""
