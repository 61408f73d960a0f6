"""The set-valued tracker: which track sets live, branch, merge and end.

Stirling & Thompson 1991 give the filter and the association test; what becomes of the sets in the
long run is decided here, every choice a parameter.
"""
