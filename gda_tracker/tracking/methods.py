"""Names of methods, ``decision/attribute term/filter``, as the command line takes them."""

from __future__ import annotations

from gda_tracker.association.choices import DECISIONS
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.kinematics.motion_models import FILTERS
from gda_tracker.parameters import ParameterError, specifications
from gda_tracker.tracking.parameters import TrackManagerParameters

DEFAULT = "default"
PARTS = ("decision", "attribute_term", "filter")


def default_method() -> str:
    """Return the method that the track manager's own defaults make."""
    declared = specifications(TrackManagerParameters)
    return "/".join(declared[part].default for part in PARTS)


def parse_method(method: str) -> dict[str, str]:
    """Return the track manager's parameters behind a method such as ``gda/dsm_classic/cv``.

    ``default`` is the method of the track manager's defaults.

    Raises
    ------
    ParameterError
        If the method does not have three known parts; the message lists what is allowed.
    """
    parts = (default_method() if method == DEFAULT else method).split("/")
    known = dict(zip(PARTS, (DECISIONS, ATTRIBUTE_TERMS, FILTERS), strict=True))
    allowed = ", ".join(f"{name} one of {'|'.join(values)}" for name, values in known.items())
    if len(parts) != len(known):
        raise ParameterError(
            f"method {method!r}: allowed is decision/attribute_term/filter with {allowed}; or "
            f"{DEFAULT}, which is {default_method()}"
        )
    for part, (name, values) in zip(parts, known.items(), strict=True):
        if part not in values:
            raise ParameterError(
                f"method {method!r}: {name} {part!r} unknown; allowed is {allowed}"
            )
    return dict(zip(known, parts, strict=True))
