"""Running the ring: four processes, or four nodes in one process, and who plays into it."""

from __future__ import annotations

import atexit
import ctypes
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TextIO

import rclpy
import yaml
from rclpy.context import Context

from gda_tracker.errors import UserError
from gda_tracker.nodes.executor import LeanExecutor
from gda_tracker.resources import resource
from gda_tracker.termination import interrupt_noted

STAGES = ("track_manager", "rcs_fuzzifier", "attribute_fusion", "association")
STOP_TIMEOUT_S = 5.0
PR_SET_PDEATHSIG = 1

# Domains beyond 101 collide with the ports that Linux hands out.
DOMAINS = 101
_reserved: dict[int, TextIO] = {}
_last_domain = os.getpid() % DOMAINS

Parameters = Mapping[str, Mapping[str, Any]]


def transport_environment(base: Mapping[str, str] | None = None) -> dict[str, str]:
    """Environment with the shipped Fast DDS profile, unless another profile is set already."""
    environment = dict(os.environ if base is None else base)
    if not environment.get("FASTDDS_DEFAULT_PROFILES_FILE") and not environment.get(
        "FASTRTPS_DEFAULT_PROFILES_FILE"
    ):
        # Both spellings: older Fast DDS reads the second.
        profile = str(resource("params", "fastdds.xml"))
        environment["FASTDDS_DEFAULT_PROFILES_FILE"] = profile
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = profile
    return environment


def reserve_domain() -> int:
    """Return a ROS domain that no other process of this host has reserved, and reserve it.

    It is held until this process ends or calls :func:`release_domain`: two rings in one domain
    would hear each other. The domain reserved last comes again last.
    """
    global _last_domain
    folder = Path(tempfile.gettempdir())
    for step in range(DOMAINS):
        domain = 1 + (_last_domain + step) % DOMAINS
        try:
            lock = (folder / f"gda_tracker_domain_{domain}.lock").open("a")
        except OSError:
            continue  # another user's
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        _reserved[domain] = lock
        _last_domain = domain
        return domain
    raise UserError(f"no free ROS domain among 1 to {DOMAINS}; name one with --domain")


def release_domain(domain: int) -> None:
    """Give a reserved domain back, when nothing runs in it any more."""
    lock = _reserved.pop(domain, None)
    if lock is not None:
        lock.close()


def private_environment(domain: int | None = None) -> dict[str, str]:
    """Environment for a ring that nobody else shall see: this host only, a domain of its own."""
    environment = transport_environment()
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    environment["ROS_DOMAIN_ID"] = str(reserve_domain() if domain is None else domain)
    return environment


def use_environment(environment: Mapping[str, str]) -> None:
    """Take the transport variables over into this process, before its first node."""
    for name, value in environment.items():
        if name.startswith(("ROS_", "FASTDDS_", "FASTRTPS_")):
            os.environ[name] = value


def parameter_file(parameters: Parameters, folder: Path) -> Path:
    """Write parameters as a ROS parameter file for the nodes of any namespace."""
    content = {
        f"/**/{node}": {"ros__parameters": dict(values)} for node, values in parameters.items()
    }
    path = folder / "parameters.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def _die_with_parent() -> None:
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


class RingProcesses:
    """The four stages, each as its own process; to be used in a ``with`` statement.

    Parameters
    ----------
    parameters
        ``{node: {parameter: value}}``.
    environment
        Environment of the children, see :func:`private_environment`.
    arguments
        Further command-line arguments for every node, e.g. a namespace remapping.
    """

    def __init__(
        self,
        parameters: Parameters,
        environment: Mapping[str, str] | None = None,
        arguments: Iterable[str] = (),
        stages: Iterable[str] = STAGES,
    ) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="gda_tracker_")
        self._environment = dict(environment or transport_environment())
        # Keep the log of a child in order when it is read by another program.
        self._environment.setdefault("RCUTILS_LOGGING_BUFFERED_STREAM", "0")
        self._arguments = list(arguments)
        used = {node: values for node, values in parameters.items() if values}
        if used:
            path = parameter_file(used, Path(self._folder.name))
            self._arguments += ["--params-file", str(path)]
        self._stages = tuple(stages)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        atexit.register(self.stop)

    def __enter__(self) -> RingProcesses:
        for stage in self._stages:
            self.start(stage)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, stage: str) -> None:
        """Start one stage."""
        command = [sys.executable, "-m", f"gda_tracker.nodes.{stage}"]
        if self._arguments:
            command += ["--ros-args", *self._arguments]
        self.processes[stage] = subprocess.Popen(
            command,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            preexec_fn=_die_with_parent if sys.platform == "linux" else None,
        )

    def kill(self, stage: str) -> None:
        """Kill one stage without warning and wait until it is gone."""
        self.processes[stage].kill()
        self.processes[stage].wait(STOP_TIMEOUT_S)

    def failed(self) -> str:
        """Say which stage has ended by itself, or nothing."""
        for stage, process in self.processes.items():
            code = process.poll()
            if code is not None:
                return f"node {stage} ended with code {code}"
        return ""

    def stop(self) -> None:
        """Stop all stages: ask, wait, then kill."""
        atexit.unregister(self.stop)
        for process in self.processes.values():
            if process.poll() is None:
                process.terminate()
        deadline = time.monotonic() + STOP_TIMEOUT_S
        for process in self.processes.values():
            try:
                process.wait(max(deadline - time.monotonic(), 0.01))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(STOP_TIMEOUT_S)
        self.processes.clear()
        self._folder.cleanup()


def stage_nodes(parameters: Parameters, **options: Any) -> list[Any]:
    """The four stages as nodes for one executor."""
    from gda_tracker.nodes.association import AssociationNode
    from gda_tracker.nodes.attribute_fusion import AttributeFusionNode
    from gda_tracker.nodes.rcs_fuzzifier import RcsFuzzifierNode
    from gda_tracker.nodes.track_manager import TrackManagerNode

    kinds = (TrackManagerNode, RcsFuzzifierNode, AttributeFusionNode, AssociationNode)
    return [
        kind(parameters.get(name, {}), **options) for name, kind in zip(STAGES, kinds, strict=True)
    ]


class Nodes:
    """Nodes in this process on one executor with a context of their own; use in ``with``."""

    def __init__(
        self,
        make: Callable[..., Iterable[Any]],
        domain: int | None = None,
        arguments: list[str] | None = None,
    ) -> None:
        self.context = Context()
        rclpy.init(args=arguments, context=self.context, domain_id=domain)
        self.nodes: list[Any] = []
        self.executor = LeanExecutor(context=self.context)
        try:
            self.nodes = list(make(context=self.context))
        except BaseException:
            rclpy.try_shutdown(context=self.context)
            raise

    def __enter__(self) -> Nodes:
        for node in self.nodes:
            self.executor.add_node(node)
            node.autostart()
        return self

    def spin_until(
        self,
        done: Callable[[], bool],
        timeout_s: float | None = None,
        watch: Callable[[], None] | None = None,
    ) -> bool:
        """Spin until ``done``; return whether it came before the time-out.

        ``watch`` is called a few times a second, e.g. to show progress or to raise. Ctrl-C comes
        between callbacks: in one it might leave half a message in a bag.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        next_watch = 0.0
        with interrupt_noted() as interrupted:
            while not done():
                if interrupted:
                    raise KeyboardInterrupt
                now = time.monotonic()
                if deadline is not None and now > deadline:
                    return False
                if watch is not None and now >= next_watch:
                    next_watch = now + 0.2
                    watch()
                self.executor.spin_once(timeout_sec=0.1)
            if interrupted:
                raise KeyboardInterrupt
        return True

    def __exit__(self, *_: object) -> None:
        # What is closed here is closed to its end, also where ``timeout`` interrupts twice.
        with interrupt_noted():
            for node in self.nodes:
                close = getattr(node, "close", None)
                if close is not None:
                    close()
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)
