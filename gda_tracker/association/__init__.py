"""Association: exact joint probabilities, and one detection per hypothesis."""
