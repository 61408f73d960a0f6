"""Kinematics: motion models, sensor models, Gaussian filters and gating, batched."""
