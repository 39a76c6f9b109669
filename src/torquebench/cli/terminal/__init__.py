"""The terminal: output, questions, keys, progress and interrupts."""
