"""Formations: how many objects fly in a group of tracks, and how groups split and merge.

Koch (2014), section 4.2. Everything here works downstream of the tracker and never changes a track.
"""
