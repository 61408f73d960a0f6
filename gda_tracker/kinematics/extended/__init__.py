"""Extended objects and groups: random matrices, ellipses, rates of detections, partitions."""
