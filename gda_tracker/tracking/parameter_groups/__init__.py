"""The parameter table of the track manager in groups, each with its own checks."""
