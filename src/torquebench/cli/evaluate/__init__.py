"""`torquebench evaluate`: tables of another bench, evaluated by the same functions."""
