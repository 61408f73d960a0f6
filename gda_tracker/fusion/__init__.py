"""Fusion of the tracks of several radars: whose tracks belong together, and what follows of it.

``fuser`` joins the parts: tracks come in, are aligned in time and frame, associated by exact
probabilities with all biases integrated out, and fused.
"""
