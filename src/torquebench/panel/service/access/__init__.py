"""Who may do what: people, programs, sessions, passwords and the command lease."""
