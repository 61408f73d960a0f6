"""Names of methods, ``decision/attribute term/filter``, as the command line takes them."""

from __future__ import annotations

from gda_tracker.association.choices import DECISIONS
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.kinematics.motion_models import FILTERS
from gda_tracker.parameters import ParameterError


def parse_method(method: str) -> dict[str, str]:
    """Return the track manager's parameters behind a method such as ``gda/dsm_classic/cv``.

    Raises
    ------
    ParameterError
        If the method does not have three known parts; the message lists what is allowed.
    """
    parts = method.split("/")
    known = {"decision": DECISIONS, "attribute_term": ATTRIBUTE_TERMS, "filter": FILTERS}
    allowed = ", ".join(f"{name} one of {'|'.join(values)}" for name, values in known.items())
    if len(parts) != len(known):
        raise ParameterError(
            f"method {method!r}: allowed is decision/attribute_term/filter with {allowed}"
        )
    for part, (name, values) in zip(parts, known.items(), strict=True):
        if part not in values:
            raise ParameterError(
                f"method {method!r}: {name} {part!r} unknown; allowed is {allowed}"
            )
    return dict(zip(known, parts, strict=True))
