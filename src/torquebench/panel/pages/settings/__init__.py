"""Settings of the bench, profiles and reducers."""
