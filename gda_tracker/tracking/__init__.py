"""Tracking: the door, the manager's state, initiation, life of a track, the ring offline."""
