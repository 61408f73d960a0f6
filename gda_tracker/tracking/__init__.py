"""Tracking: the door, the track manager's state, initiation, life of a track, and the ring offline."""
