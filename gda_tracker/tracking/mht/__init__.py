"""Track-oriented multiple hypothesis tracking: trees of hypotheses that decide over several scans.

Koch 2014, sections 3.2 and 3.3, with the global hypothesis of
:mod:`gda_tracker.association.global_hypotheses`.
"""
