"""What is written beside a formation, and which of them can be drawn."""

from __future__ import annotations

import numpy as np

from gda_tracker.formations.found import Formation


def formation_text(one: Formation) -> str:
    """The number with its probability, the one decided, and where the formation comes from."""
    best = int(np.argmax(one.number_probabilities))
    text = f"F{one.formation_id}: {best + 1} ({100.0 * one.number_probabilities[best]:.0f} %)"
    text += f"\ndecided {one.number}" if one.number else "\nundecided"
    for word, others in (("from", one.parent_ids), ("split off", one.child_ids)):
        if others:
            text += f"\n{word} " + ", ".join(f"F{other}" for other in others)
    return text


def is_finite(one: Formation) -> bool:
    """Whether place, extent and probabilities of a formation can be drawn."""
    return bool(
        np.isfinite(one.position).all()
        and np.isfinite(one.extent).all()
        and len(one.number_probabilities)
        and np.isfinite(one.number_probabilities).all()
    )
