"""Transmission error over full output revolutions."""
