"""Authorisation: people, programs, sessions, passwords and the command lease."""
