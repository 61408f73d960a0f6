"""The installed package: one version, console scripts, data files, use from any folder.

These tests look at the environment that runs them, so gda_tracker must be
installed there (``make setup``). The environment with the oldest numpy and
scipy has no installation; its run leaves this file out.
"""

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib import metadata
from pathlib import Path

import pytest

import gda_tracker
from gda_tracker import resources

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.prefix) / "bin"
NODES = (
    "association",
    "attribute_fusion",
    "evaluator",
    "markers",
    "radar_input",
    "rcs_fuzzifier",
    "recorder",
    "scan_source",
    "track_events",
    "track_formations",
    "track_fusion",
    "track_manager",
    "track_output",
    "set_valued_tracker",
)


def run(*command, cwd, **environment):
    """Run a command away from the checkout and return its standard output."""
    result = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def run_python(code, cwd, **environment):
    return json.loads(run(sys.executable, "-c", code, cwd=cwd, **environment))


def manifest_version(path):
    return ElementTree.parse(path).findtext("version").strip()


def test_version_is_that_of_package_xml():
    stated = manifest_version(ROOT / "package.xml")
    assert gda_tracker.__version__ == stated
    assert metadata.version("gda_tracker") == stated


def test_both_packages_have_one_version():
    assert manifest_version(ROOT / "msg_schemas" / "package.xml") == manifest_version(
        ROOT / "package.xml"
    )


def test_changelog_describes_the_version():
    assert f"## [{gda_tracker.__version__}]" in (ROOT / "CHANGELOG.md").read_text()


def test_installed_package_knows_its_version(tmp_path):
    code = (
        "import gda_tracker, json;"
        "print(json.dumps([gda_tracker.__version__, gda_tracker.__file__]))"
    )
    version, file = run_python(code, tmp_path)
    assert version == manifest_version(ROOT / "package.xml")
    assert Path(file).is_relative_to(sys.prefix)


def test_version_without_installation(tmp_path):
    """A copy of the sources that nobody installed reads its package.xml."""
    (tmp_path / "gda_tracker").mkdir()
    text = (ROOT / "gda_tracker" / "__init__.py").read_text()
    (tmp_path / "gda_tracker" / "__init__.py").write_text(text)
    (tmp_path / "package.xml").write_text("<package><version>9.8.7</version></package>")
    code = "import gda_tracker, json; print(json.dumps(gda_tracker.__version__))"
    assert run_python(code, tmp_path) == "9.8.7"


def test_console_scripts_are_declared_and_installed():
    declared = {
        entry.name: entry.value for entry in metadata.distribution("gda_tracker").entry_points
    }
    assert declared == {
        "gda-tracker": "gda_tracker.cli:main",
        **{node: f"gda_tracker.nodes.{node}:main" for node in NODES},
    }
    for name in declared:
        assert os.access(BIN / name, os.X_OK), name


@pytest.mark.parametrize("name", ["gda-tracker", *NODES])
def test_console_scripts_can_be_imported(name):
    (entry,) = metadata.entry_points(group="console_scripts", name=name)
    assert callable(entry.load())


@pytest.mark.parametrize("name", ["gda-tracker", *NODES])
def test_launch_finds_the_executables(name):
    """launch_ros looks for <prefix>/lib/<package>/<executable>."""
    executable = Path(sys.prefix) / "lib" / "gda_tracker" / name
    assert executable.resolve() == (BIN / name).resolve()


def test_command_line_works_from_another_folder(tmp_path):
    assert "usage" in run(BIN / "gda-tracker", "--help", cwd=tmp_path).lower()


def test_ament_index_lists_the_package(tmp_path):
    code = (
        "from ament_index_python import get_package_share_directory as share; import json;"
        "print(json.dumps([share('gda_tracker'), share('gda_tracker_msgs')]))"
    )
    environment = {"AMENT_PREFIX_PATH": ""}
    prefix = Path(sys.prefix)
    assert run_python(code, tmp_path, **environment) == [
        str(prefix / "share" / "gda_tracker"),
        str(prefix / "share" / "gda_tracker_msgs"),
    ]


def test_installed_resources_are_those_of_the_checkout(tmp_path):
    code = (
        "from gda_tracker.resources import share_directory; import json;"
        "share = share_directory();"
        "files = [p.relative_to(share).as_posix() for p in share.rglob('*')"
        " if p.is_file() and p.suffix != '.pyc'];"
        "print(json.dumps([str(share), sorted(files)]))"
    )
    share, installed = run_python(code, tmp_path, AMENT_PREFIX_PATH="")
    assert Path(share) == Path(sys.prefix) / "share" / "gda_tracker"
    expected = ["package.xml"]
    for folder in ("params", "launch", "data", "msg_schemas/msg"):
        for path in (ROOT / folder).rglob("*"):
            relative = path.relative_to(ROOT)
            hidden = any(part.startswith((".", "__pycache__")) for part in relative.parts)
            if path.is_file() and not hidden:
                expected.append(relative.as_posix())
                assert (Path(share) / relative).read_bytes() == path.read_bytes(), relative
    assert installed == sorted(expected)
    assert any(name.startswith("msg_schemas/msg/") for name in installed)


def test_resources_of_a_checkout_are_its_own():
    assert resources.share_directory() == ROOT
    assert resources.resource("msg_schemas", "msg").is_dir()
    assert resources.resource("package.xml") == ROOT / "package.xml"


def test_resources_prefer_the_sourced_workspace(tmp_path):
    """An installed package takes the share folder the ament index points to."""
    overlay = tmp_path / "overlay"
    marker = overlay / "share/ament_index/resource_index/packages/gda_tracker"
    marker.parent.mkdir(parents=True)
    marker.touch()
    (overlay / "share/gda_tracker").mkdir()
    (overlay / "share/gda_tracker/package.xml").touch()
    code = (
        "from gda_tracker.resources import share_directory; import json;"
        "print(json.dumps(str(share_directory())))"
    )
    found = run_python(code, tmp_path, AMENT_PREFIX_PATH=str(overlay))
    assert found == str(overlay / "share" / "gda_tracker")


def test_missing_resource_names_what_was_looked_for():
    with pytest.raises(FileNotFoundError, match=r"msg_schemas.no_such_file.*package\.xml"):
        resources.resource("msg_schemas", "no_such_file")
    with pytest.raises(FileNotFoundError, match="no_such_folder"):
        resources.resource("no_such_folder", "file.yaml")


MESSAGE_ROUND_TRIP = """
import json
import rclpy
from gda_tracker_msgs.msg import ScanKey
from rclpy.serialization import deserialize_message, serialize_message

rclpy.init()
node = rclpy.create_node("packaging_test")
node.create_publisher(ScanKey, "packaging_test", 1)
message = ScanKey()
print(json.dumps(deserialize_message(serialize_message(message), ScanKey) == message))
node.destroy_node()
rclpy.shutdown()
"""


@pytest.mark.parametrize(
    "removed",
    [
        (),
        ("_ROS_WHEELS_BOOTSTRAP_COMPLETE",),
        ("LD_LIBRARY_PATH",),
        ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "AMENT_PREFIX_PATH"),
    ],
    ids=["inherited", "no guard", "no library path", "clean"],
)
def test_messages_work_in_child_processes(tmp_path, removed):
    """Whatever part of the environment a child inherits, rclpy and the messages load."""
    environment = {key: value for key, value in os.environ.items() if key not in removed}
    environment.update(ROS_LOG_DIR=str(tmp_path), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    result = subprocess.run(
        [sys.executable, "-c", MESSAGE_ROUND_TRIP],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) is True
