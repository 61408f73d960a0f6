"""Layers of markers: what each shows of a run, when it is deleted, what each parameter does."""

import dataclasses

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
from hypothesis import given, settings
from hypothesis import strategies as st
from marker_viewer import Viewer
from rclpy.serialization import deserialize_message
from scipy.stats import chi2
from visualization_msgs.msg import Marker, MarkerArray

from gda_tracker.io.bag_types import serialize
from gda_tracker.io.markers import cdr, layers, shapes
from gda_tracker.io.markers.layers import Layers
from gda_tracker.io.markers.parameters import (
    COLOUR_NAMES,
    LAYERS,
    MarkerParameters,
    colour_of,
    marker_topics,
)
from gda_tracker.kinematics.gating import gate
from gda_tracker.kinematics.sensor_models import polar_measurements
from gda_tracker.parameters import ParameterError, from_mapping, specifications
from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.gates import gates_of
from gda_tracker.tracking.ring import Ring


def marker_array(update, parameters):
    """What a subscriber gets of an update."""
    return deserialize_message(cdr.marker_array(update, parameters), MarkerArray)


METHOD = "mht/bayes/imm"
PER_TRACK = ("tracks", "covariances", "labels")
ALL_LIVE = set(LAYERS) - {"tracks_delayed"}


@pytest.fixture(scope="module")
def run():
    """Results of the ring on the crossing targets: start, life and end of tracks."""
    scenario = load_scenario("crossing_targets")
    (play,) = of_scenario(scenario, 1, 3, METHOD)
    parameters = with_method(tracker_preset(scenario), METHOD)
    manager = {**parameters["track_manager"], "initiation": "automatic", "deletion_misses": 2}
    manager["mht_scans"] = 2
    ring = Ring({**parameters, "track_manager": manager})
    found = [ring.process(detections) for detections in play.detections]
    # Silence at the end: tracks coast and end.
    last = play.detections[-1]
    step = last.stamp_ns - play.detections[-2].stamp_ns
    none = np.zeros(0)
    for k in range(1, 4):
        empty = dataclasses.replace(
            last, stamp_ns=last.stamp_ns + k * step, range_m=none, azimuth_rad=none, rcs_m2=None,
            rcs_valid=None, sequence=last.sequence + k,
        )  # fmt: skip
        found.append(ring.process(empty))
    assert all(result.tracks is not None for result in found)
    assert len(found[-1].tracks) == 0
    return found


def table(**values):
    return from_mapping(MarkerParameters, values)


class Watched:
    """Layers with a viewer each."""

    def __init__(self, looked_at=LAYERS, **values):
        self.p, self.looked_at = table(**values), set(looked_at)
        self.layers = Layers(lambda name: name in self.looked_at and name in self.p.layers)
        self.viewers = {name: Viewer() for name in LAYERS}
        self.updates = []

    def _show(self, updates):
        self.updates += updates
        for update in updates:
            self.viewers[update.layer].take(marker_array(update, self.p))

    def scan(self, result):
        """Take a result in the order in which the ring publishes."""
        self._show(self.layers.take_scan(result.scan, self.p))
        self._show(self.layers.take_predictions(result.predictions, self.p))
        self._show(self.layers.take_tracks(result.tracks, self.p))
        for tracks in result.delayed:
            self._show(self.layers.take_delayed(tracks, self.p))

    def content(self):
        """All that is shown, to compare."""
        return {name: dict(viewer.shown) for name, viewer in self.viewers.items()}


def ids(tracks):
    return sorted(tracks.track_id.tolist())


def test_after_every_scan_the_layers_show_exactly_what_is_there(run):
    watched = Watched()
    view = watched.viewers
    past = {}
    seen_status = set()
    for result in run:
        watched.scan(result)
        tracks, scan = result.tracks, result.scan
        for name in PER_TRACK:
            assert view[name].ids() == ids(tracks), name
        by_status = {
            status: sorted(tracks.track_id[tracks.status == number].tolist())
            for number, status in enumerate(("tentative", "confirmed"))
        }
        seen_status |= {s for s, ids_of in by_status.items() if ids_of}
        for status, expected in by_status.items():
            assert view["tracks"].ids(status) == expected
        past = {i: past.get(i, []) for i in ids(tracks)}
        for row, i in enumerate(tracks.track_id.tolist()):
            past[i].append(tracks.mean[row, :2])
            status = "confirmed" if tracks.status[row] else "tentative"
            marker = view["tracks"].shown[status, i]
            at = [marker.pose.position.x, marker.pose.position.y]
            np.testing.assert_array_equal(at, tracks.mean[row, :2])
            assert marker.header.frame_id == tracks.frame_id == "map"
            stamp = marker.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == result.report.key.stamp_ns
            assert view["labels"].shown[status, i].text.startswith(f"{i} ")
            if len(past[i]) > 1:
                np.testing.assert_array_equal(view["trails"].points(("trails", i)), past[i][-50:])
        assert view["trails"].ids() == sorted(i for i, points in past.items() if len(points) > 1)
        assert len(view["detections"].shown) == (len(scan) > 0)
        if len(scan):
            polar = polar_measurements(scan)
            x = polar.sensor_xy_m[0] + polar.range_m * np.cos(polar.azimuth_rad)
            (name,) = view["detections"].shown
            np.testing.assert_allclose(view["detections"].points(name)[:, 0], x, rtol=1e-12)
        taken = np.count_nonzero(tracks.detection_index >= 0)
        lines = view["associations"].shown.values()
        assert sum(len(marker.points) for marker in lines) == 2 * taken
        gated = ids(result.predictions) if len(scan) else []
        assert view["gates"].ids() == sorted(set(gated))
        assert len(view["sensors"].shown) == 2
    assert seen_status == {"confirmed", "tentative"}
    assert any(update.layer == "tracks_delayed" and update.shapes for update in watched.updates)


def test_associations_end_at_the_detection_and_the_track(run):
    watched = Watched(("associations",))
    result = next(r for r in run[5:] if (r.tracks.detection_index >= 0).sum() >= 2)
    watched.scan(result)
    ((name, _),) = watched.viewers["associations"].shown.items()
    lines = watched.viewers["associations"].points(name).reshape(-1, 2, 2)
    tracks, scan = result.tracks, result.scan
    position = shapes.detection_positions(scan)
    expected = {
        (tuple(tracks.mean[row, :2]), tuple(position[scan.source_index.tolist().index(index)]))
        for row, index in enumerate(tracks.detection_index.tolist())
        if index >= 0
    }
    assert {(tuple(a), tuple(b)) for a, b in lines} == expected


@pytest.mark.parametrize("order", ["tps", "pst"])
def test_the_order_in_which_messages_come_makes_no_difference(run, order):
    usual, other = Watched(), Watched()
    for result in run[:7]:
        usual.scan(result)
        takers = {
            "s": lambda r: other.layers.take_scan(r.scan, other.p),
            "p": lambda r: other.layers.take_predictions(r.predictions, other.p),
            "t": lambda r: other.layers.take_tracks(r.tracks, other.p),
        }
        for letter in order:
            other._show(takers[letter](result))
        for tracks in result.delayed:
            other._show(other.layers.take_delayed(tracks, other.p))
        assert other.content() == usual.content()


def test_a_message_that_comes_again_changes_nothing(run):
    watched = Watched(detection_persistence_s=1000.0)
    for result in run[:8]:
        watched.scan(result)
    before = watched.content()
    watched.scan(dataclasses.replace(run[7], delayed=[]))
    assert watched.content() == before


def test_who_looks_later_sees_the_same_but_for_the_past(run):
    early, late = Watched(), Watched(looked_at=())
    for number, result in enumerate(run[:15]):
        if number == 10:
            late.looked_at = set(LAYERS)
        early.scan(result)
        late.scan(result)
        if number < 10:
            assert not late.updates
    for name in (*PER_TRACK, "velocities", "associations", "gates", "sensors"):
        assert late.content()[name] == early.content()[name], name
    seen = [[m.points for m in w.viewers["detections"].shown.values()] for w in (early, late)]
    assert seen[0] == seen[1]
    # Whatever an earlier run of the node has left in the viewer goes first.
    assert late.updates[0].anew
    array = marker_array(late.updates[0], late.p)
    assert array.markers[0].action == Marker.DELETEALL
    (trail,) = {len(m.points) for m in late.viewers["trails"].shown.values()} - {2, 3, 4}
    assert trail == 5


def test_nothing_is_made_for_layers_that_nobody_looks_at(run, monkeypatch):
    def never(*_):
        raise AssertionError("was made though nobody looks")

    for name in ("detections", "sensor", "gate_lines", "associations", "track_spheres",
                 "velocity_arrows", "covariance_ellipses", "colours"):  # fmt: skip
        monkeypatch.setattr(shapes, name, never)
    watched = Watched(("labels",))
    monkeypatch.setattr(shapes, "labels", lambda *_: [])
    for result in run[:5]:
        watched.scan(result)
    assert {update.layer for update in watched.updates} == {"labels"}


@pytest.mark.parametrize("change", ["epoch", "time"])
def test_a_restarted_manager_and_time_set_back_begin_anew(run, change):
    watched = Watched(detection_persistence_s=1000.0)
    for result in run[:12]:
        watched.scan(result)
    assert len(watched.viewers["detections"].shown) == 12

    def shifted(part):
        key = part.key
        if change == "epoch":
            key = key._replace(epoch=key.epoch + 1)
        fields = {"key": key}
        if hasattr(part, "mean"):
            fields["track_id"] = part.track_id + 100
        return dataclasses.replace(part, **fields)

    first = len(watched.updates)
    for result in run[:3]:
        again = dataclasses.replace(
            result,
            scan=shifted(result.scan),
            predictions=shifted(result.predictions),
            tracks=shifted(result.tracks),
            delayed=[],
        )
        watched.scan(again)
    anew = [update.layer for update in watched.updates[first:] if update.anew]
    assert sorted(anew) == sorted(ALL_LIVE)
    assert watched.viewers["tracks"].ids() == (run[2].tracks.track_id + 100).tolist()
    assert len(watched.viewers["detections"].shown) == 3
    assert watched.layers.is_old(run[0].tracks.key) == (change == "epoch")


def test_detections_stay_as_long_as_is_asked_for_and_never_without_bound(run):
    step_s = (run[1].scan.key.stamp_ns - run[0].scan.key.stamp_ns) * 1e-9
    watched = Watched(("detections",), detection_persistence_s=3.2 * step_s)
    for number, result in enumerate(run[:10], 1):
        watched.scan(result)
        assert len(watched.viewers["detections"].shown) == min(number, 4)


def test_however_long_detections_stay_their_number_is_bounded(run, monkeypatch):
    monkeypatch.setattr(layers, "MOST_SCANS", 30)
    many = Watched(("detections",), detection_persistence_s=3600.0)
    scan = run[3].scan
    for k in range(50):
        later = dataclasses.replace(scan, key=scan.key._replace(stamp_ns=10**9 + k))
        many._show(many.layers.take_scan(later, many.p))
    assert len(many.viewers["detections"].shown) == 30


def test_detections_of_each_sensor_stay_until_its_next_scan(run):
    watched = Watched(("detections", "sensors"))
    for sensor, result in zip(("bow", "stern", "bow", "mast"), run, strict=False):
        key = result.scan.key._replace(sensor_id=sensor)
        scan = dataclasses.replace(result.scan, key=key)
        watched._show(watched.layers.take_scan(scan, watched.p))
    for name in ("detections", "sensors"):
        assert {ns for ns, _ in watched.viewers[name].shown} == {"bow", "stern", "mast"}


def test_tracks_without_finite_states_are_left_out(run):
    tracks = next(r.tracks for r in run if len(r.tracks) >= 2)
    mean, covariance = tracks.mean.copy(), tracks.covariance.copy()
    mean[0, 1] = np.nan
    broken = dataclasses.replace(tracks, mean=mean)
    watched = Watched()
    watched._show(watched.layers.take_tracks(broken, watched.p))
    assert watched.viewers["tracks"].ids() == ids(tracks)[1:]
    covariance[1, 0, 0] = np.inf
    broken = dataclasses.replace(tracks, covariance=covariance, key=tracks.key)
    assert shapes.drawable(broken).tolist() == [True, False, *[True] * (len(tracks) - 2)]
    short = dataclasses.replace(tracks, mean=mean[:, :2], covariance=covariance[:, :2, :2])
    assert not shapes.drawable(short).any()


def test_numbers_of_64_bits_fit_and_stay(run):
    tracks = next(r.tracks for r in run if len(r.tracks) >= 2)
    large = dataclasses.replace(tracks, track_id=tracks.track_id + 2**40)
    watched = Watched(("tracks", "labels"))
    watched._show(watched.layers.take_tracks(large, watched.p))
    assert watched.viewers["tracks"].ids() == [(i + 2**40) % 2**31 for i in ids(tracks)]
    texts = {m.text.split()[0] for m in watched.viewers["labels"].shown.values()}
    assert texts == {str(i + 2**40) for i in ids(tracks)}


def test_the_bytes_are_those_of_the_messages_field_by_field():
    """Against the serialiser of the rosbags library, which knows the definitions alone."""
    points = np.array([[1.5, -2.5], [3.0, 4.0], [5.0, 6.0]])
    blue = colour_of("#0000ff80")
    update = layers.Update(
        "tracks",
        1_234_567_890_123,
        "map",
        [
            shapes.Shape(
                "é", 2**31 - 1, shapes.TEXT, blue, (0, 0, 3), (1, 2, 3), 0.5, text="äx\n7"
            ),
            shapes.Shape("abc", 0, shapes.LINE_STRIP, blue, (0.25, 0, 0), points=points),
            shapes.Shape("", 7, shapes.SPHERE, blue, (1, 2, 3), (-1.0, 0.5, 9.0), -3.0),
        ],
        gone=[("confirmed", 5), ("a", 6)],
        anew=True,
    )
    p = table(lifetime_s=2.25, height_m=-1.5)
    written = cdr.marker_array(update, p)
    expected = []
    for action, namespace, number in ((3, "", 0), (2, "confirmed", 5), (2, "a", 6)):
        expected.append(Marker(action=action, ns=namespace, id=number))
    for shape in update.shapes:
        marker = Marker(ns=shape.namespace, id=shape.number, type=shape.kind, text=shape.text)
        for part, names, values in (
            (marker.pose.position, "xyz", shape.position),
            (marker.scale, "xyz", shape.scale),
            (marker.color, "rgba", shape.colour),
        ):
            for name, value in zip(names, values, strict=True):
                setattr(part, name, float(value))
        marker.pose.orientation.z = float(np.sin(0.5 * shape.yaw_rad))
        marker.pose.orientation.w = float(np.cos(0.5 * shape.yaw_rad))
        marker.points = [Point(x=float(x), y=float(y), z=-1.5) for x, y in shape.points]
        marker.lifetime = Duration(sec=2, nanosec=250_000_000)
        expected.append(marker)
    for marker in expected:
        marker.header.stamp.sec, marker.header.stamp.nanosec = 1234, 567_890_123
        marker.header.frame_id = "map"
    for marker in expected[:3]:
        marker.pose.orientation.w = 1.0
    assert written == serialize(MarkerArray(markers=expected))
    empty = cdr.marker_array(layers.Update("tracks", 0, ""), p)
    assert deserialize_message(empty, MarkerArray) == MarkerArray()


# --- geometry -------------------------------------------------------------------------------------


def test_an_ellipse_by_hand():
    covariance = np.array([[[4.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 9.0]]])
    axes, yaw = shapes.ellipses(covariance, 1.0 - np.exp(-2.0))
    # -2 log exp(-2) = 4: twice the standard deviations.
    np.testing.assert_allclose(axes, [[4.0, 2.0], [6.0, 2.0]], rtol=1e-12)
    np.testing.assert_allclose(np.abs(np.sin(yaw)), [0.0, 1.0], atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-50.0, 50.0), min_size=4, max_size=4),
    st.floats(0.01, 0.999),
    st.floats(-np.pi, np.pi),
)
def test_the_edge_of_an_ellipse_has_the_mahalanobis_distance_of_its_probability(
    entries, probability, angle
):
    root = np.array(entries).reshape(2, 2)
    covariance = root @ root.T + 0.5 * np.eye(2)
    (axes,), (yaw,) = shapes.ellipses(covariance[None], probability)
    along = axes[0] * np.cos(angle) * np.array([np.cos(yaw), np.sin(yaw)])
    point = along + axes[1] * np.sin(angle) * np.array([-np.sin(yaw), np.cos(yaw)])
    squared = point @ np.linalg.solve(covariance, point)
    assert squared == pytest.approx(chi2.ppf(probability, 2), rel=1e-6)


def test_detections_are_gated_that_lie_within_the_line_of_the_gate(run):
    """The lines against the gate that association uses, on detections all around."""
    result = next(r for r in run if r.predictions is not None and len(r.predictions) >= 2)
    scan, predictions = result.scan, result.predictions
    gates = gates_of(scan, predictions, None)
    edges = gates.outlines(scan.sensor_position_m[:2], 720)
    noise = np.median(scan.noise_covariance, axis=0)
    rng = np.random.default_rng(2)
    agree, inside_count = 0, 0
    for g, edge in enumerate(edges):
        low, high = edge.min(axis=0), edge.max(axis=0)
        point = rng.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (400, 2))
        off = point - scan.sensor_position_m[:2]
        around = dataclasses.replace(
            scan,
            range_m=np.hypot(*off.T),
            azimuth_rad=np.arctan2(off[:, 1], off[:, 0]),
            noise_covariance=np.tile(noise, (400, 1, 1)),
            source_index=np.arange(400, dtype=np.int32),
            rcs_m2=np.zeros(400),
            rcs_valid=np.zeros(400, dtype=bool),
            elevation_rad=None,
            range_rate_mps=None,
        )
        alone = _heaviest(predictions, gates.track_id[g])
        pairs = gate(around, alone)
        gated = np.isin(np.arange(400), pairs.detection)
        x, y = edge[:-1].T
        turns = np.zeros(400)
        for a in range(len(x)):
            b = (a + 1) % len(x)
            crossing = (y[a] > point[:, 1]) != (y[b] > point[:, 1])
            at = (x[b] - x[a]) * (point[:, 1] - y[a]) / (y[b] - y[a] + 1e-300) + x[a]
            turns += crossing & (point[:, 0] < at)
        inside = turns % 2 == 1
        agree += np.count_nonzero(inside == gated)
        inside_count += np.count_nonzero(inside)
    assert agree >= 0.995 * 400 * len(edges)
    assert inside_count > 50 * len(edges)


def _heaviest(predictions, track_id):
    """The heaviest component of the first hypothesis of a track, alone."""
    row = int(np.flatnonzero(predictions.track_id == track_id)[0])
    first, last = predictions.component_start[row : row + 2]
    component = first + int(np.argmax(predictions.component_weight[first:last]))
    changed = {
        f.name: getattr(predictions, f.name)[[row]]
        for f in dataclasses.fields(predictions)
        if f.name in ("hypothesis_id", "parent_id", "track_id", "detection_probability")
    }
    return dataclasses.replace(
        predictions,
        **changed,
        component_start=np.array([0, 1], dtype=np.int32),
        component_weight=np.ones(1),
        component_model=predictions.component_model[[component]],
        component_mean=predictions.component_mean[[component]],
        component_covariance=predictions.component_covariance[[component]],
    )


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
