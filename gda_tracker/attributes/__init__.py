"""Attributes: RCS and class models, fuzzification, attribute fusion, generalised measurements."""
