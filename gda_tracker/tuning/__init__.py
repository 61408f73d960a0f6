"""Search of parameters: ranges, cases to score, objectives, the search itself, and its report."""
