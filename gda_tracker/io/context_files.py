"""Files of lanes and plans for the tests of events, which ask more of a plan than the filter does.

The format and its reading are those of :mod:`gda_tracker.tracking.context_files`.
"""

from __future__ import annotations

from pathlib import Path

from gda_tracker.events.sequential import DIRECTION_LOSS
from gda_tracker.kinematics.context import Context
from gda_tracker.tracking import context_files
from gda_tracker.tracking.context_files import ContextFileError

__all__ = ["ContextFileError", "parse_context", "read_context_file"]


def read_context_file(path: str | Path) -> Context:
    """Return the lanes and plans of a YAML file.

    Raises
    ------
    ContextFileError
        If the file cannot be read, is not YAML, a key is unknown or missing, or a value is not
        allowed; the message names file, lane or plan, and key.
    """
    return _with_margins(context_files.read_context_file(path), str(context_files.full_path(path)))


def parse_context(text: str, name: str) -> Context:
    """Return the lanes and plans of a YAML text; ``name`` stands for it in errors.

    Raises
    ------
    ContextFileError
        As :func:`read_context_file`.
    """
    return _with_margins(context_files.parse_context(text, name), name)


def _with_margins(context: Context, name: str) -> Context:
    """Refuse plans between whose hypotheses the tests could not tell."""
    for k, plan in enumerate(context.plans, 1):
        # A departure seen from one of several directions looks shorter; it must still be one.
        least = float(plan.tolerance_along_m.max()) * (1.0 / DIRECTION_LOSS - 1.0)
        if plan.margin_m <= least:
            raise ContextFileError(
                f"{name}: plan {k} ({plan.name}): margin_m = {plan.margin_m}: allowed is a number "
                f"> {least:.4g}, {1.0 / DIRECTION_LOSS - 1.0:.2%} of the largest tolerance_m"
            )
    return context
