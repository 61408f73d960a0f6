"""Exact association probability between any number of sensors, with bias and features.

(Ferry 2010, "Exact association probability for data with bias and features".) The probability that
measurements of several sensors arose from the same objects; the sensors' biases are integrated out,
not estimated first.
"""
