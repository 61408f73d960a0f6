"""Names of methods: parsed into the manager's parameters, or refused with what is allowed."""

import itertools

import pytest

from gda_tracker.association.choices import DECISIONS
from gda_tracker.attributes.terms import ATTRIBUTE_TERMS
from gda_tracker.kinematics.motion_models import FILTERS
from gda_tracker.parameters import ParameterError, from_mapping
from gda_tracker.tracking.methods import default_method, parse_method
from gda_tracker.tracking.parameters import TrackManagerParameters


@pytest.mark.parametrize("parts", [*itertools.product(DECISIONS, ATTRIBUTE_TERMS, FILTERS)])
def test_every_combination_is_a_method_that_the_manager_takes(parts):
    values = parse_method("/".join(parts))
    assert tuple(values.values()) == parts
    table = from_mapping(TrackManagerParameters, values)
    assert (table.decision, table.attribute_term, table.filter) == parts


def test_default_is_what_a_manager_does_that_is_told_nothing():
    table = from_mapping(TrackManagerParameters, parse_method("default"))
    assert table == TrackManagerParameters()
    assert default_method() == f"{table.decision}/{table.attribute_term}/{table.filter}"


@pytest.mark.parametrize(
    ("method", "culprit"),
    [
        ("", "method ''"),
        ("gda", "method 'gda'"),
        ("gda/none", "method 'gda/none'"),
        ("gda/none/cv/x", "method 'gda/none/cv/x'"),
        ("best/none/cv", "decision 'best' unknown"),
        ("gda/guess/cv", "attribute_term 'guess' unknown"),
        ("gda/none/ca", "filter 'ca' unknown"),
        ("GDA/none/cv", "decision 'GDA' unknown"),
        ("gda//cv", "attribute_term '' unknown"),
    ],
)
def test_anything_else_is_refused_with_what_is_allowed(method, culprit):
    with pytest.raises(ParameterError) as error:
        parse_method(method)
    text = str(error.value)
    assert culprit in text
    assert "\n" not in text
    for names in (DECISIONS, ATTRIBUTE_TERMS, FILTERS):
        assert "|".join(names) in text
