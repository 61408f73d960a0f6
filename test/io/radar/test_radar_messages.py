"""Messages of radars as frames: every field, also after a bag; what cannot be read is named."""

from types import SimpleNamespace

import numpy as np
import pytest
from cloud_examples import cloud

from gda_tracker.errors import UserError
from gda_tracker.io.bag_types import new_type_store, type_hash, type_store
from gda_tracker.io.bags import Bag, BagTopic, BagWriter, read_bag
from gda_tracker.io.foreign_types import RADAR_MESSAGES
from gda_tracker.io.radar.frames import frame_of_columns, quantities_of_frame
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.messages import (
    POINT_CLOUD,
    RADAR_SCAN,
    RADAR_TRACKS,
    RadarMessageError,
    detections_of_message,
    frame_of_message,
)
from gda_tracker.io.radar.point_cloud import PointCloudError, point_cloud_of_columns, read_fields
from gda_tracker.parameters import ParameterError, from_mapping

STAMP_NS = 12_000_000_034


def table(**values):
    return from_mapping(RadarInputParameters, values)


def header(stamp_ns=STAMP_NS, frame_id="front", store=None):
    types = (store or type_store()).types
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def radar_scan(returns):
    types = type_store().types
    return types[RADAR_SCAN](
        header=header(),
        returns=[types["radar_msgs/msg/RadarReturn"](*values) for values in returns],
    )


def radar_tracks(rows, covariance=(0.0,) * 6):
    """Tracks of (position, velocity)."""
    types = type_store().types
    vector, point = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Point"]
    six = np.array(covariance, dtype=np.float32)
    return types[RADAR_TRACKS](
        header=header(),
        tracks=[
            types["radar_msgs/msg/RadarTrack"](
                uuid=types["unique_identifier_msgs/msg/UUID"](uuid=np.zeros(16, np.uint8)),
                position=point(*position),
                velocity=vector(*velocity),
                acceleration=vector(0.0, 0.0, 0.0),
                size=vector(4.0, 2.0, 1.5),
                classification=2,
                position_covariance=six,
                velocity_covariance=np.zeros(6, np.float32),
                acceleration_covariance=np.zeros(6, np.float32),
                size_covariance=np.zeros(6, np.float32),
            )
            for position, velocity in rows
        ],
    )


def test_a_radar_scan_through_a_bag(tmp_path):
    sent = radar_scan([(100.0, 0.5, 0.0625, -3.0, 0.0), (50.0, -0.25, 0.0, 2.0, 0.0)])
    with BagWriter(tmp_path / "bag", [BagTopic("/radar", RADAR_SCAN)]) as bag:
        bag.write("/radar", sent, STAMP_NS)
    (record,) = read_bag(tmp_path / "bag")
    scan = detections_of_message(record.message(), record.type, table(), sequence=7)
    found = scan.detections
    assert (found.stamp_ns, found.frame_id, found.sequence) == (STAMP_NS, "front", 7)
    assert found.range_m.tolist() == [100.0, 50.0]
    assert found.azimuth_rad.tolist() == [0.5, -0.25]
    assert found.elevation_rad.tolist() == [0.0625, 0.0]
    assert found.range_rate_mps.tolist() == [-3.0, 2.0]
    # amplitude is never a radar cross section by itself, but may be declared as one.
    assert found.rcs_m2 is None
    declared = table(field_names=["rcs=amplitude"], rcs_unit="dbsm")
    assert detections_of_message(sent, RADAR_SCAN, declared).detections.rcs_m2.tolist() == [1, 1]


def test_a_scan_without_returns_is_a_scan():
    found = detections_of_message(radar_scan([]), RADAR_SCAN, table()).detections
    assert found.range_m.shape == (0,)


def test_radar_tracks_give_positions_radial_speeds_and_deviations():
    # Speed 5 across the line of sight and 2 along it; 3-4-5 triangle.
    position, along = np.array([30.0, 40.0, 0.0]), np.array([0.6, 0.8, 0.0])
    across = np.array([-0.8, 0.6, 0.0])
    matrix = 0.25 * np.outer(along, along) + 4.0 * np.outer(across, across)
    matrix[2, 2] = 1.0
    six = matrix[np.triu_indices(3)]
    message = radar_tracks([(position, 2.0 * along + 5.0 * across)] * 2, six)
    found = detections_of_message(message, RADAR_TRACKS, table(elevation_used=False)).detections
    np.testing.assert_allclose(found.range_m, 50.0)
    np.testing.assert_allclose(found.azimuth_rad, np.arctan2(4, 3))
    np.testing.assert_allclose(found.range_rate_mps, 2.0)
    np.testing.assert_allclose(found.range_std_m, 0.5, rtol=1e-6)
    np.testing.assert_allclose(found.azimuth_std_rad, 2.0 / 50.0, rtol=1e-6)
    lengths = detections_of_message(
        message, RADAR_TRACKS, table(attribute_fields=["length_m=length"])
    ).detections
    assert lengths.attribute_values.tolist() == [[4.0, 4.0]]


def test_tracks_without_covariance_bring_no_deviations():
    found = detections_of_message(
        radar_tracks([((10.0, 0.0, 0.0), (1.0, 0.0, 0.0))]), RADAR_TRACKS, table()
    ).detections
    assert found.range_std_m is None
    assert found.azimuth_std_rad is None
    assert detections_of_message(radar_tracks([]), RADAR_TRACKS, table()).detections.sequence == 0


def test_the_definitions_make_the_hash_of_the_package():
    """Comments and constants, which the package's own files have, take no part in it."""
    from rosbags.typesys import get_types_from_msg

    store = new_type_store(without=["radar_msgs"])
    assert RADAR_SCAN not in store.fielddefs
    text = "float32 range # m\nfloat32 azimuth\nfloat32 elevation\nfloat32 doppler_velocity\n"
    types = get_types_from_msg(text + "float32 amplitude\n", "radar_msgs/msg/RadarReturn")
    scan = "uint16 NONE=0\nstd_msgs/Header header\nradar_msgs/RadarReturn[] returns\n"
    types.update(get_types_from_msg(scan, RADAR_SCAN))
    store.register(types)
    assert store.hash_rihs01(RADAR_SCAN) == type_hash(RADAR_SCAN)
    assert set(RADAR_MESSAGES) <= set(type_store().fielddefs)


def test_a_bag_with_an_earlier_definition_is_read_by_its_own(tmp_path):
    """The first versions of radar_msgs had other tracks: a number and a text."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_types_from_msg

    store = new_type_store(without=["radar_msgs"])
    text = (
        "uint16 track_id\ngeometry_msgs/Point position\ngeometry_msgs/Vector3 velocity\n"
        "geometry_msgs/Vector3 acceleration\ngeometry_msgs/Vector3 size\nstring classification\n"
    )
    types = get_types_from_msg(text, "radar_msgs/msg/RadarTrack")
    tracks = "std_msgs/Header header\nradar_msgs/RadarTrack[] tracks\n"
    types.update(get_types_from_msg(tracks, RADAR_TRACKS))
    store.register(types)
    known = store.types
    vector, point = known["geometry_msgs/msg/Vector3"], known["geometry_msgs/msg/Point"]
    zero = vector(0.0, 0.0, 0.0)
    track = known["radar_msgs/msg/RadarTrack"](
        3, point(3.0, 4.0, 0.0), vector(6.0, 8.0, 0.0), zero, zero, "Car"
    )
    message = known[RADAR_TRACKS](header(store=store), [track])
    path = tmp_path / "old"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/tracks", RADAR_TRACKS, typestore=store)
        writer.write(connection, STAMP_NS, store.serialize_cdr(message, RADAR_TRACKS))
    (record,) = Bag(path).records()
    found = detections_of_message(record.message(), record.type, table()).detections
    assert found.range_m.tolist() == [5.0]
    assert found.range_rate_mps.tolist() == [10.0]


def test_a_point_cloud_is_read_as_the_parameters_say():
    rcs = np.array([1.5, -2.25])
    message = cloud(
        {"x": [3.0, 6.0], "y": [4.0, 8.0], "z": [0.0, 0.0], "rcs": rcs},
        [("x", "f4", 0), ("y", "f4", 4), ("z", "f4", 8), ("rcs", "f4", 17)],
        declared={"rcs": "u1"},
    )
    message.header = header()
    frame = frame_of_message(message, POINT_CLOUD)
    assert frame.types == {"x": "float32", "y": "float32", "z": "float32", "rcs": "uint8"}
    fields = quantities_of_frame(frame, table(field_types=["rcs=float32"], rcs_unit="dbsm"))
    np.testing.assert_array_equal(fields["rcs"], rcs)
    scan = detections_of_message(message, POINT_CLOUD, table())
    assert scan.detections.range_m.tolist() == [5.0, 10.0]


def test_stamps_of_the_message_or_of_its_arrival():
    scan = radar_scan([])
    received = table(stamp_source="received")
    assert detections_of_message(scan, RADAR_SCAN, received, 0, 99).detections.stamp_ns == 99
    assert detections_of_message(scan, RADAR_SCAN, table(), 0, 99).detections.stamp_ns == STAMP_NS
    scan.header.stamp.sec = -1
    with pytest.raises(RadarMessageError, match=r"header.stamp = -1 s"):
        detections_of_message(scan, RADAR_SCAN, table(), 0, 99)
    assert detections_of_message(scan, RADAR_SCAN, received, 0, 99).detections.stamp_ns == 99


def test_what_does_not_fit_is_named():
    with pytest.raises(RadarMessageError, match=r"type x/msg/Y: allowed is one of sensor_msgs"):
        frame_of_message(SimpleNamespace(), "x/msg/Y")
    frame = frame_of_columns("csv", 0, "", {"x": np.ones(1), "y": np.ones(1)})
    for values, message in (
        ({"attribute_fields": ["snr_db=snr"]}, "attribute_fields: snr, but the fields are x, y"),
        ({"field_names": ["x=u"]}, "x=u, but the fields are x, y"),
        (
            {"field_names": ["x=y", "y="], "attribute_fields": ["a=x"]},
            "x is also the name of a quantity that field_names takes from y",
        ),
    ):
        with pytest.raises(ParameterError, match=message):
            quantities_of_frame(frame, table(**values))


def test_a_point_cloud_that_is_written_is_read_back():
    columns = {"x": np.array([1.5, -2.0]), "id": np.array([3.0, 65535.0]), "rcs": [-128, 127]}
    types = {"x": "float32", "id": "uint16", "rcs": "int8"}
    for offsets, step in ((None, 0), ({"x": 4, "id": 1, "rcs": 9}, 16)):
        message = point_cloud_of_columns(columns, types, STAMP_NS, "r", offsets, step)
        found = read_fields(message, columns)
        for name, values in columns.items():
            np.testing.assert_array_equal(found[name], values)
    with pytest.raises(PointCloudError, match="'rcs': a value that is no int8"):
        point_cloud_of_columns({"rcs": [128]}, {"rcs": "int8"}, 0, "")
    with pytest.raises(PointCloudError, match="point_step = 3: allowed is at least 4"):
        point_cloud_of_columns({"x": [1.0]}, {"x": "float32"}, 0, "", None, 3)
    assert issubclass(PointCloudError, UserError)
