"""`torquebench doctor`: the installation and, with a description, the bench."""
