"""One file a test of a reducer: settings, plan, evaluation on this bench, and figures."""
