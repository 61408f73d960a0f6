"""What the environment of this process says, before any node is started: no ROS is needed."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gda_tracker.nodes.diagnosis.findings import ERROR, NOTE, WARNING, Finding
from gda_tracker.resources import resource

MESSAGES = "gda_tracker_msgs"
LARGEST_DOMAIN = 232
# Beyond it the ports of a domain collide with those that Linux hands out to anybody.
LARGEST_SAFE_DOMAIN = 101
UNUSABLE = ("rclpy_missing", "messages_missing", "middleware_missing", "domain_invalid")
IMPORT_TIMEOUT_S = 60.0
RANGES = ("SYSTEM_DEFAULT", "SUBNET", "LOCALHOST", "OFF")
# A process of ours takes a shared-memory segment of 32 MB.
ENOUGH_SHARED_MEMORY = 64 * 2**20
SHARED_MEMORY = Path("/dev/shm")
# DDS: ports of a domain begin here and are so many.
FIRST_PORT, PORTS_PER_DOMAIN = 7400, 250


def environment_findings(
    environment: Mapping[str, str] | None = None, domain: int | None = None
) -> list[Finding]:
    """Look at packages, variables and shared memory.

    Parameters
    ----------
    environment
        By default that of this process.
    domain
        ROS domain in place of that of the environment.
    """
    e = os.environ if environment is None else environment
    return [
        *_packages(e),
        *_python_path(e),
        *_domain(e, domain),
        *_discovery(e),
        *_transport(e),
        *_python_checks(e),
        *_shared_memory(),
    ]


def unusable(findings: list[Finding]) -> bool:
    """Whether no node can be started here."""
    return any(f.name in UNUSABLE for f in findings)


def _packages(e: Mapping[str, str]) -> list[Finding]:
    middleware = e.get("RMW_IMPLEMENTATION", "")
    if middleware:
        # With one that is not installed the import does not fail, it ends the process.
        done = subprocess.run(
            [sys.executable, "-c", "import rclpy"],
            env=dict(e),
            capture_output=True,
            text=True,
            timeout=IMPORT_TIMEOUT_S,
        )
        if done.returncode not in (0, 1):
            return [
                Finding(
                    ERROR,
                    "middleware_missing",
                    "RMW_IMPLEMENTATION",
                    f"is {middleware}, with which rclpy ends: {_last_line(done.stderr)}",
                    "no node can be started",
                    "unset RMW_IMPLEMENTATION, or install the middleware: "
                    f"apt install ros-jazzy-{middleware.replace('_', '-')}",
                )
            ]
    try:
        importlib.import_module("rclpy")
    except ImportError as error:
        return [
            Finding(
                ERROR,
                "rclpy_missing",
                "rclpy",
                f"cannot be imported: {_one_line(error)}",
                "without it there are no nodes",
                ". /opt/ros/jazzy/setup.sh, or make setup and .venv/bin/gda-tracker",
            )
        ]
    try:
        messages = importlib.import_module(f"{MESSAGES}.msg")
    except ImportError as error:
        return [
            Finding(
                ERROR,
                "messages_missing",
                MESSAGES,
                f"cannot be imported: {_one_line(error)}",
                "the messages of the ring are not built, or their workspace is not sourced",
                "make setup, or colcon build --base-paths src/gda_tracker/msg_schemas and "
                ". install/setup.sh",
            )
        ]
    stale = _stale_messages(messages)
    if not stale:
        return []
    return [
        Finding(
            ERROR,
            "messages_outdated",
            MESSAGES,
            f"built from other definitions: {', '.join(stale)}",
            "nodes of two versions do not hear each other",
            "make setup, or colcon build and . install/setup.sh; restart all nodes",
        )
    ]


def _stale_messages(messages: Any) -> list[str]:
    """Messages whose fields are not those of the definitions that came with this package."""
    stale = []
    for path in sorted(resource("msg_schemas", "msg").glob("*.msg")):
        lines = (line.split("#")[0].strip() for line in path.read_text().splitlines())
        fields = [line.split()[1] for line in lines if line and "=" not in line]  # no constants
        kind = getattr(messages, path.stem, None)
        if kind is None or list(kind.get_fields_and_field_types()) != fields:
            stale.append(path.stem)
    return stale


def _python_path(e: Mapping[str, str]) -> list[Finding]:
    own = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    others = {
        found for found in re.findall(r"python3\.\d+", e.get("PYTHONPATH", "")) if found != own
    }
    if not others:
        return []
    return [
        Finding(
            WARNING,
            "python_mixed",
            "PYTHONPATH",
            f"has packages of {', '.join(sorted(others))}, this is {own}",
            "compiled packages such as rclpy and numpy fail to load, or are not ours",
            "unset PYTHONPATH, or use the Python of the ROS installation that was sourced",
        )
    ]


def _domain(e: Mapping[str, str], domain: int | None) -> list[Finding]:
    text = e.get("ROS_DOMAIN_ID", "") if domain is None else str(domain)
    if not text:
        return []
    if not text.strip().isdigit() or int(text) > LARGEST_DOMAIN:
        return [
            Finding(
                ERROR,
                "domain_invalid",
                "ROS_DOMAIN_ID",
                f"is {text!r}",
                f"a domain is a number from 0 to {LARGEST_DOMAIN}",
                "export ROS_DOMAIN_ID=0, the same in every terminal",
            )
        ]
    if int(text) > LARGEST_SAFE_DOMAIN:
        return [
            Finding(
                NOTE,
                "domain_high",
                "ROS_DOMAIN_ID",
                f"is {text}",
                f"above {LARGEST_SAFE_DOMAIN} its ports may be taken by other programs on Linux",
                "export ROS_DOMAIN_ID=0, or another up to 101",
            )
        ]
    return []


def _discovery(e: Mapping[str, str]) -> list[Finding]:
    found = []
    reach = e.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    if reach and reach.upper() not in RANGES:
        found.append(
            Finding(
                ERROR,
                "discovery_range_invalid",
                "ROS_AUTOMATIC_DISCOVERY_RANGE",
                f"is {reach!r}",
                f"allowed is one of {', '.join(RANGES)}",
                "unset ROS_AUTOMATIC_DISCOVERY_RANGE",
            )
        )
    elif reach.upper() == "OFF":
        found.append(
            Finding(
                ERROR,
                "discovery_off",
                "ROS_AUTOMATIC_DISCOVERY_RANGE",
                "is OFF",
                "nodes find only the peers in ROS_STATIC_PEERS, not even those of this host",
                "unset ROS_AUTOMATIC_DISCOVERY_RANGE",
            )
        )
    elif reach.upper() == "LOCALHOST" or e.get("ROS_LOCALHOST_ONLY") == "1":
        name = (
            "ROS_LOCALHOST_ONLY"
            if e.get("ROS_LOCALHOST_ONLY") == "1"
            else ("ROS_AUTOMATIC_DISCOVERY_RANGE")
        )
        found.append(
            Finding(
                NOTE,
                "discovery_localhost",
                name,
                f"is {e[name]}",
                "nodes of this host are found, a radar's driver on another machine is not",
                f"unset {name}, here and where the other nodes are started",
            )
        )
    if e.get("ROS_DISCOVERY_SERVER"):
        found.append(
            Finding(
                NOTE,
                "discovery_server",
                "ROS_DISCOVERY_SERVER",
                f"is {e['ROS_DISCOVERY_SERVER']}",
                "only nodes that use the same server are found, and tools see the graph only as "
                "super clients",
                "export ROS_SUPER_CLIENT=TRUE, and the same server in every terminal",
            )
        )
    return found


def _transport(e: Mapping[str, str]) -> list[Finding]:
    found = []
    for name in ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        path = e.get(name)
        if not path:
            continue
        fault = _fault_of_profile(Path(path))
        if fault:
            found.append(
                Finding(
                    ERROR,
                    "profile_unreadable",
                    name,
                    f"is {path}: {fault}",
                    "Fast DDS goes on with its defaults: messages above 400 KB stall for seconds",
                    f"unset {name}; gda-tracker then uses its own profile",
                )
            )
    middleware = e.get("RMW_IMPLEMENTATION", "")
    if middleware and middleware != "rmw_fastrtps_cpp":
        found.append(
            Finding(
                NOTE,
                "middleware",
                "RMW_IMPLEMENTATION",
                f"is {middleware}",
                "nodes of different middlewares do not hear each other reliably; the transport "
                "profile of gda-tracker is for Fast DDS",
                "the same RMW_IMPLEMENTATION in every terminal, or unset RMW_IMPLEMENTATION",
            )
        )
    return found


def _fault_of_profile(path: Path) -> str:
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        return str(error.strerror)
    except ElementTree.ParseError as error:
        return f"no XML, {error}"
    if root.tag.rsplit("}")[-1] not in ("profiles", "dds"):
        return f"no profiles, but {root.tag}"
    return ""


def _python_checks(e: Mapping[str, str]) -> list[Finding]:
    if e.get("ROS_PYTHON_CHECK_FIELDS", "") in ("", "0"):
        return []
    return [
        Finding(
            NOTE,
            "field_checks",
            "ROS_PYTHON_CHECK_FIELDS",
            f"is {e['ROS_PYTHON_CHECK_FIELDS']}",
            "every number of every message is checked in Python, which costs time with long arrays",
            "unset ROS_PYTHON_CHECK_FIELDS, outside of tests",
        )
    ]


def _shared_memory() -> list[Finding]:
    try:
        status = os.statvfs(SHARED_MEMORY)
    except OSError:
        return []  # no Linux: there is another way
    free = status.f_bavail * status.f_frsize
    if free >= ENOUGH_SHARED_MEMORY:
        return []
    return [
        Finding(
            WARNING,
            "shared_memory_full",
            str(SHARED_MEMORY),
            f"has {free / 2**20:.0f} MB left",
            "each process of the tracker takes 32 MB there; without, nodes find each other but "
            "messages do not arrive",
            "docker run --shm-size=512m, rm /dev/shm/fastrtps_* when no node runs, or "
            "export FASTDDS_DEFAULT_PROFILES_FILE=params/fastdds_udp.xml",
        )
    ]


def busy_domains(tables: tuple[Path, ...] | None = None) -> list[int]:
    """Domains in which some process of this host seems to be, by the UDP ports that are open.

    DDS gives domain d the ports from 7400 + 250 d on. Nothing is sent to find this out.
    """
    if tables is None:
        tables = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
    found = set()
    for table in tables:
        try:
            lines = table.read_text().splitlines()[1:]
        except OSError:
            continue  # no Linux, or no IPv6
        for line in lines:
            port = int(line.split()[1].rsplit(":", 1)[1], 16)
            domain, place = divmod(port - FIRST_PORT, PORTS_PER_DOMAIN)
            if 0 <= domain <= LARGEST_SAFE_DOMAIN and (place == 0 or place >= 10):
                found.add(domain)
    return sorted(found)


def _one_line(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else "without a word"
