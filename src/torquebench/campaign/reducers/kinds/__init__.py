"""The tests of a reducer, one file each: settings, plan, evaluation on this bench, and figures."""
