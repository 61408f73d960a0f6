"""What tracks do, seen from their states: leave lanes and plans, stop, accelerate, split off.

Everything here works on ``tracks`` alone, downstream of the tracker, and never changes them.
"""
