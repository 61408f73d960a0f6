"""Pictures of recordings, tracks, beliefs and scores, drawn from the vocabulary's objects.

Every function returns a matplotlib figure; :func:`~gda_tracker.evaluation.figures.canvas.png`
renders it. matplotlib is imported only when a picture is drawn.
"""

from gda_tracker.evaluation.figures.attributes import (
    class_beliefs,
    membership_functions,
    pignistic_entropies,
)
from gda_tracker.evaluation.figures.canvas import MissingPlotLibraryError, png, require_matplotlib
from gda_tracker.evaluation.figures.courses import (
    conflict_course,
    nis_course,
    stage_latencies,
)
from gda_tracker.evaluation.figures.flow import (
    candidate_histories,
    fuzzy_reading,
    gate_outlines,
    gated_maps,
    pair_tables,
)
from gda_tracker.evaluation.figures.formations import stated_numbers
from gda_tracker.evaluation.figures.lives import (
    belief_courses,
    plan_position,
    rcs_courses,
    track_lives,
)
from gda_tracker.evaluation.figures.maps import association_maps, track_map
from gda_tracker.evaluation.figures.quality import consistency_course, set_distance_course
from gda_tracker.evaluation.figures.reliability import reliability
from gda_tracker.evaluation.figures.scores import latency_histograms, paired_purity

__all__ = [
    "MissingPlotLibraryError",
    "association_maps",
    "belief_courses",
    "candidate_histories",
    "class_beliefs",
    "conflict_course",
    "consistency_course",
    "fuzzy_reading",
    "gate_outlines",
    "gated_maps",
    "latency_histograms",
    "membership_functions",
    "nis_course",
    "pair_tables",
    "paired_purity",
    "pignistic_entropies",
    "plan_position",
    "png",
    "rcs_courses",
    "reliability",
    "require_matplotlib",
    "set_distance_course",
    "stage_latencies",
    "stated_numbers",
    "track_lives",
    "track_map",
]
