"""Extended objects in the track manager: cells of a scan, extents of the hypotheses."""
