"""`torquebench plant`: sending and asking in the registry of many benches."""
