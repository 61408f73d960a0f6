"""What each parameter of the markers does, from which scan on."""

import pytest
from marker_run import ALL_LIVE, Watched, marker_results, table

from gda_tracker.io.markers.parameters import (
    COLOUR_NAMES,
    LAYERS,
    MarkerParameters,
    colour_of,
    marker_topics,
)
from gda_tracker.parameters import ParameterError, specifications


@pytest.fixture(scope="module")
def run():
    """Results of the ring on the crossing targets."""
    return marker_results()


# --- parameters -----------------------------------------------------------------------------------

# A new value for each parameter, and what else has to hold for it to show.
CASES = {
    "layers": (["tracks"], {}),
    "scale": (3.0, {}),
    "show_tentative": (False, {}),
    "colour_by": ("track", {}),
    "class_colours": (["fighter=#ff0000", "cargo=#00ff00"], {}),
    "confirmed_colour": ("#ff0000", {"colour_by": "status"}),
    "tentative_colour": ("#ff0000", {}),
    "detection_colour": ("#ff0000", {}),
    "association_colour": ("#ff0000", {}),
    "gate_colour": ("#ff0000", {}),
    "delayed_colour": ("#ff0000", {}),
    "sensor_colour": ("#ff0000", {}),
    "formation_colour": ("#ff0000", {}),
    "formation_margin_m": (7.0, {}),
    "ellipse_probability": (0.5, {}),
    "ellipse_opacity": (0.9, {}),
    "detection_size_m": (7.0, {}),
    "track_size_m": (7.0, {}),
    "label_size_m": (7.0, {}),
    "line_width_m": (7.0, {}),
    "velocity_s": (9.0, {}),
    "detection_persistence_s": (1000.0, {}),
    "trail_scans": (3, {}),
    "delayed_scans": (3, {}),
    "height_m": (12.0, {}),
    "lifetime_s": (1.5, {}),
}


def test_every_parameter_of_the_layers_has_a_case():
    declared = specifications(MarkerParameters)
    # Curves are those of sensors that do not locate: test_sensor_model_shapes.py.
    assert sorted([*CASES, "curve_farthest_m"]) == sorted(declared)
    assert all(item.live for item in declared.values())


@pytest.fixture(scope="module")
def plain_run(run):
    """What is shown after four and after six scans, by the parameters that hold throughout."""
    found = {}

    def of(base):
        key = str(sorted(base.items()))
        if key not in found:
            found[key] = _contents(run, base, base)
        return found[key]

    return of


def _contents(run, base, later):
    watched = Watched(**base)
    seen = []
    for number, result in enumerate(run[4:10], 1):
        if number == 5:
            watched.p = table(**later)
        watched.scan(result)
        if number in (4, 6):
            seen.append(watched.content())
    return (*seen, {u.layer for u in watched.updates if u.stamp_ns > run[8].scan.key.stamp_ns})


@pytest.mark.parametrize("name", CASES)
def test_a_parameter_acts_from_the_next_scan_on(name, run, plain_run):
    value, base = CASES[name]
    before, after, fresh = _contents(run, base, {**base, name: value})
    expected = plain_run(base)
    assert before == expected[0]
    if name == "layers":
        assert (fresh, expected[2] - {"tracks_delayed"}) == ({"tracks"}, ALL_LIVE)
    else:
        assert after != expected[1]


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (
            {"gate_colour": "pink"},
            "gate_colour: colour 'pink': allowed is '#rrggbb' or '#rrggbbaa'",
        ),
        ({"class_colours": ["cargo"]}, "class_colours: 'cargo', allowed are entries class=colour"),
        ({"class_colours": ["a=#000000", "a=#ffffff"]}, "entries class=colour that differ"),
        ({"class_colours": ["cargo=#12"]}, "class_colours: colour '#12'"),
        ({"layers": ["lidar"]}, "layers = ['lidar']: allowed is a list, each one of detections"),
        ({"ellipse_probability": 1.0}, "ellipse_probability = 1.0: allowed is a number > 0 and"),
        ({"scale": 0.0}, "scale = 0.0: allowed is a number > 0"),
    ],
)
def test_wrong_parameters_are_named(values, text):
    with pytest.raises(ParameterError) as caught:
        table(**values)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_colours_and_topics():
    assert colour_of("#ff0080") == (1.0, 0.0, pytest.approx(128 / 255), 1.0)
    assert colour_of("#00000080")[3] == pytest.approx(128 / 255)
    assert colour_of("red") == (1.0, 0.0, 0.0, 1.0)
    assert all(colour_of(name) == colour_of(text) for name, text in COLOUR_NAMES.items())
    assert "markers/tracks=visualization_msgs/msg/MarkerArray" in marker_topics()
    assert len(marker_topics()) == len(LAYERS)
