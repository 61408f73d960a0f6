"""Generalised measurements: what people and coarse sensors say, as likelihoods (Mahler 2011).

A statement such as "somewhere in the harbour", "about 10 m/s", "by the buoy, I am 70 % sure" or "if
it is in the channel it is fast" is a random closed subset Theta of a measurement space. Its
one-point covering function mu(z) = Pr(z in Theta) gives the likelihood of a state, and averaged
over a track the likelihood of the association, beside those of radar detections.
"""

from gda_tracker.attributes.generalised_measurements.combinations import (
    FuzzyDempsterShafer,
    Projection,
    Rule,
    Statements,
)
from gda_tracker.attributes.generalised_measurements.covering import CoveringFunction
from gda_tracker.attributes.generalised_measurements.fuzzy import (
    Everything,
    GaussianShaped,
    Membership,
)
from gda_tracker.attributes.generalised_measurements.grades import mixture_grade, rule_grade
from gda_tracker.attributes.generalised_measurements.likelihoods import (
    log_association_likelihood,
    log_association_likelihood_by_quadrature,
    log_clutter_likelihood,
    log_generalised_likelihood,
)
from gda_tracker.attributes.generalised_measurements.quadrature import QuadratureError
from gda_tracker.attributes.generalised_measurements.regions import (
    Box,
    Polygon,
    Sector,
    annular_sector,
)
from gda_tracker.attributes.generalised_measurements.scalars import (
    PiecewiseLinear,
    interval,
    quantised,
    trapezoid,
    triangle,
)

__all__ = [
    "Box",
    "CoveringFunction",
    "Everything",
    "FuzzyDempsterShafer",
    "GaussianShaped",
    "Membership",
    "PiecewiseLinear",
    "Polygon",
    "Projection",
    "QuadratureError",
    "Rule",
    "Sector",
    "Statements",
    "annular_sector",
    "interval",
    "log_association_likelihood",
    "log_association_likelihood_by_quadrature",
    "log_clutter_likelihood",
    "log_generalised_likelihood",
    "mixture_grade",
    "quantised",
    "rule_grade",
    "trapezoid",
    "triangle",
]
