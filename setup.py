"""Installation of gda_tracker with pip or colcon."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

NAME = "gda_tracker"
ROOT = Path(__file__).resolve().parent
NODES = (
    "track_manager",
    "rcs_fuzzifier",
    "attribute_fusion",
    "association",
    "scan_source",
    "evaluator",
    "recorder",
    "radar_input",
    "track_output",
    "markers",
    "set_valued_tracker",
    "track_fusion",
    "track_events",
    "track_formations",
)


def version() -> str:
    """Version as stated in package.xml, the only place that states it."""
    text = ElementTree.parse(ROOT / "package.xml").findtext("version")
    if not text:
        raise RuntimeError(f"{ROOT / 'package.xml'} states no <version>")
    return text.strip()


def data_files(*folders: str) -> list[tuple[str, list[str]]]:
    """(target, files) pairs that install whole folders below share/gda_tracker."""
    groups: dict[str, list[str]] = {}
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*")):
            relative = path.relative_to(ROOT)
            hidden = any(part.startswith((".", "__pycache__")) for part in relative.parts)
            if path.is_file() and not hidden:
                target = f"share/{NAME}/{relative.parent.as_posix()}"
                groups.setdefault(target, []).append(relative.as_posix())
    return sorted(groups.items())


setup(
    name=NAME,
    version=version(),
    description="Multi-target radar tracking with generalised data association",
    author="gda_tracker developers",
    author_email="gda-tracker@example.org",
    maintainer="gda_tracker developers",
    maintainer_email="gda-tracker@example.org",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        "": ["py.typed", "**/*.css", "**/*.html", "**/*.js", "**/*.json", "**/*.svg", "**/*.yaml"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        # The message definitions let bags be read and written without the built messages.
        *data_files("params", "launch", "data", "msg_schemas/msg"),
    ],
    zip_safe=False,
    # rclpy and the message packages come from the ROS installation, see package.xml.
    install_requires=["numpy>=1.26", "scipy>=1.11", "PyYAML"],
    extras_require={
        "asterix": ["dpkt", "libasterix"],
        "bags": ["rosbags"],
        "report": ["matplotlib", "tqdm"],
        "tune": ["optuna>=5", "matplotlib", "rosbags", "tqdm"],
        "view": ["aiohttp", "plotly"],
        "test": [
            "aiohttp",
            "dpkt",
            "evidencelib==1.3.0",
            "filterpy",
            "hypothesis",
            "libasterix",
            "matplotlib",
            "optuna>=5",
            "playwright",
            "plotly",
            "pytest",
            "pytest-timeout",
            "pytest-xdist",
            "rosbags",
            "tqdm",
        ],
        "dev": ["import-linter", "mypy", "pre-commit", "ruff", "types-PyYAML"],
        "benchmark": ["stonesoup==1.9.1", "rosbags"],
    },
    entry_points={
        "console_scripts": [
            "gda-tracker = gda_tracker.cli:main",
            *(f"{node} = gda_tracker.nodes.{node}:main" for node in NODES),
        ],
    },
)
