"""Set-valued tracking: filter and association test of Stirling & Thompson 1991.

A track is not one estimate but a convex set of them, all with equal claim to be the mean of the
target's state. :mod:`~gda_tracker.kinematics.set_valued.filter` carries the sets through time,
:mod:`~gda_tracker.kinematics.set_valued.association_test` says which observations a set may own.
"""
