"""`torquebench records`: list, show, check, back up and restore."""
