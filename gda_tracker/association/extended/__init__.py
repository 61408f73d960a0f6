"""Extended objects: which detections are of which object, and a tracker of the positions alone."""
