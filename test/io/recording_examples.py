"""Small recordings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np


def npz_arrays(**changes) -> dict:
    """Arrays of a small scenario: 3 scans with 2, 0 and 3 detections, 2 targets."""
    azimuth = np.array([0.0, np.pi / 2, np.pi, -np.pi / 2, -3.0])
    meta = {"seed": 7, "sigma_range": 60.0, "sigma_azimuth": 0.005, "p_detect": 0.97}
    meta["clutter_density"] = 2e-5
    arrays = {
        "times": np.array([0.0, 5.0, 10.0]),
        "scan_ptr": np.array([0, 2, 2, 5]),
        "azimuth": azimuth,
        "range": np.array([1e4, 2e4, 3e4, 4e4, 5e4]),
        "rcs": np.array([1.0, 2.0, 0.3, 4.0, 5.0]),
        "truth_id": np.array([0, 1, -1, 1, 0]),
        "truth_state": np.arange(24.0).reshape(3, 2, 4),
        "truth_type": np.array([0, 1]),
        "truth_group": np.array([0, 0]),
        "meta": np.array(json.dumps(meta)),
    }
    arrays.update(changes)
    return {name: value for name, value in arrays.items() if value is not None}


def npz(tmp_path, **changes) -> Path:
    path = tmp_path / "scenario.npz"
    np.savez(path, **npz_arrays(**changes))
    return path
