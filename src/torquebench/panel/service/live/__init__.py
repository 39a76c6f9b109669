"""Live values, alarms and the present state of the bench."""
