"""Settings of the bench, profiles and reducers, with history and undo."""
