"""`torquebench evaluate`: evaluate tables of other benches."""
