"""What radars publish, as detections: point clouds and returns of any layout, declared by a table.

``point_cloud`` reads fields out of bytes, ``input_parameters`` declares what they mean,
``conversion`` makes detections of them: units, signs, radar cross section, ego motion, clusters.
"""
