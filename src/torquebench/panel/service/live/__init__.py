"""Live values, alarms and the state of the bench at one moment."""
