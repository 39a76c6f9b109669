"""One open bench."""
