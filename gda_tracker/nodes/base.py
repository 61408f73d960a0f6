"""What all nodes of the ring share: lifecycle, parameters, drop counters, diagnostics."""

from __future__ import annotations

import gc
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from gda_tracker.nodes.executor import LeanExecutor
from gda_tracker.nodes.hearing import Hearing
from gda_tracker.parameters import ParameterError, from_mapping, specifications

DIAGNOSTICS_PERIOD_S = 1.0
OWN_PARAMETERS = ("autostart",)
# Parameters that rclpy declares by itself.
ROS_PARAMETERS = ("use_sim_time", "start_type_description_service")

# What broken input can raise inside a stage; anything else is a defect and may end the node.
STAGE_ERRORS = (ArithmeticError, LookupError, TypeError, ValueError)


class RingNode(LifecycleNode):
    """A lifecycle node with a declarative parameter table, counters and diagnostics.

    Subclasses create their topics in :meth:`open_topics` with :meth:`subscribe` and
    :meth:`advertise` and take new parameters in :meth:`use_parameters`.

    Parameters
    ----------
    name
        Name of the node.
    table
        Parameter table, a dataclass of :func:`gda_tracker.parameters.parameter` fields.
    parameters
        Values in place of the table's defaults, under those from the command line.
    """

    def __init__(
        self,
        name: str,
        table: type,
        parameters: Mapping[str, Any] | None = None,
        **options: Any,
    ) -> None:
        overrides = [Parameter(key, value=value) for key, value in (parameters or {}).items()]
        super().__init__(name, parameter_overrides=overrides, **options)
        self._table = table
        self._specifications = specifications(table)
        self.counters: Counter[str] = Counter()
        self.active = False
        self._outputs: list[Any] = []
        self._inputs: list[Any] = []
        self._hearings: list[Hearing] = []
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.parameters = self._declare_parameters()
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(
            lambda _: self.use_parameters(self._read_parameters())
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._each_second, clock=self._steady)

    # --- parameters -------------------------------------------------------------------------

    def _declare_parameters(self) -> Any:
        known = (*self._specifications, *OWN_PARAMETERS, *ROS_PARAMETERS)
        for name in self._parameter_overrides:
            if name not in known and not name.startswith("qos_overrides."):
                from_mapping(self._table, {name: None})  # raises, with the names that are allowed
        self.declare_parameter("autostart", True)
        for name, item in self._specifications.items():
            descriptor = ParameterDescriptor(
                description=item.description + (f" [{item.unit}]" if item.unit else ""),
                additional_constraints=f"allowed is {item.allowed}",
                read_only=not item.live,
                # The table checks types itself: it takes 10 for 10.0 and says what is wrong.
                dynamic_typing=True,
            )
            self.declare_parameter(name, item.default, descriptor)
        return self._read_parameters()

    def _read_parameters(self, changed: Mapping[str, Any] | None = None) -> Any:
        values = {name: self.get_parameter(name).value for name in self._specifications}
        values.update(changed or {})
        for name, value in values.items():
            if self._specifications[name].is_list:
                # An empty list of a parameter file arrives as None, a full one as an array.
                values[name] = [] if value is None else value
        return from_mapping(self._table, values)

    def _check_parameters(self, changed: list[Parameter]) -> SetParametersResult:
        """Accept or refuse a change as a whole, with a reason."""
        values = {p.name: p.value for p in changed if p.name in self._specifications}
        try:
            self.check_parameters(self._read_parameters(values))
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def check_parameters(self, parameters: Any) -> None:
        """Raise :class:`ParameterError` for a change that does not go with what the node knows."""

    def use_parameters(self, parameters: Any) -> None:
        """Take checked parameters; acts at the next scan."""
        self.parameters = parameters

    # Every event callback is one more thing that every wait of the executor has to set up; by
    # default there are several for each publisher and subscription.

    def create_publisher(self, *arguments: Any, **options: Any) -> Any:
        """Create a publisher without event callbacks, unless given."""
        options.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        return super().create_publisher(*arguments, **options)

    def create_subscription(self, *arguments: Any, **options: Any) -> Any:
        """Create a subscription without event callbacks, unless given."""
        options.setdefault(
            "event_callbacks", SubscriptionEventCallbacks(use_default_callbacks=False)
        )
        return super().create_subscription(*arguments, **options)

    # --- topics -----------------------------------------------------------------------------

    def open_topics(self) -> None:
        """Create subscriptions and publishers; called on configure."""
        raise NotImplementedError

    def subscribe(
        self,
        message: type,
        topic: str,
        callback: Callable[[Any], None],
        quality: QoSProfile,
        sent_again: bool = False,
        **kw: Any,
    ) -> None:
        """Subscribe while configured; the callback runs only while active.

        With ``sent_again`` the subscription is made anew where nothing is heard; only for topics
        on which everything that is not answered comes again.
        """

        def guarded(received: Any) -> None:
            if self.active:
                callback(received)

        def create(receive: Callable[[Any], None]) -> Any:
            return self.create_subscription(
                message,
                topic,
                receive,
                quality,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                **kw,
            )

        if not sent_again:
            self._inputs.append(create(guarded))
            return
        name = self.resolve_topic_name(topic)

        def publishers() -> frozenset[bytes]:
            found = self.get_publishers_info_by_topic(name)
            return frozenset(bytes(info.endpoint_gid) for info in found)

        self._hearings.append(Hearing(create, self.destroy_subscription, guarded, publishers))

    def _renew_deaf_inputs(self) -> None:
        now = self.seconds()
        for item in self._hearings:
            if item.check(now):
                self.counters["renewed_subscription"] += 1

    def advertise(self, message: type, topic: str, quality: QoSProfile) -> Any:
        """Publish while configured."""
        publisher = self.create_publisher(
            message,
            topic,
            quality,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._outputs.append(publisher)
        return publisher

    def drop(self, reason: str, detail: str = "") -> None:
        """Count something that was dropped, and say so, at most once in five seconds a reason."""
        self.counters[reason] += 1
        self.get_logger().warning(
            f"dropped: {reason}" + (f" ({detail})" if detail else ""), throttle_duration_sec=5.0
        )

    # --- lifecycle --------------------------------------------------------------------------

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Create the topics."""
        try:
            self.open_topics()
        except STAGE_ERRORS:
            self.get_logger().error(traceback.format_exc())
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Start to answer."""
        self.active = True
        return super().on_activate(state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Stop to answer; inputs are ignored."""
        self.active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Remove the topics."""
        for item in self._inputs:
            self.destroy_subscription(item)
        for hearing in self._hearings:
            hearing.close()
        for item in self._outputs:
            self.destroy_publisher(item)
        self._inputs, self._hearings, self._outputs = [], [], []
        return super().on_cleanup(state)

    def autostart(self) -> None:
        """Configure and activate, unless the parameter ``autostart`` says no."""
        if self.get_parameter("autostart").value:
            self.trigger_configure()
            self.trigger_activate()

    def seconds(self) -> float:
        """Steady time [s]."""
        return self._steady.now().nanoseconds * 1e-9

    # --- diagnostics ------------------------------------------------------------------------

    def health(self) -> tuple[int, str]:
        """Level and one line for diagnostics; subclasses add what they know."""
        return (
            (DiagnosticStatus.OK, "active") if self.active else (DiagnosticStatus.WARN, "inactive")
        )

    def figures(self) -> dict[str, Any]:
        """Further values for diagnostics."""
        return {}

    def _each_second(self) -> None:
        self._renew_deaf_inputs()
        self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        level, text = self.health()
        for publisher in self._outputs:
            topic = publisher.topic_name
            if self.count_publishers(topic) > 1:
                level = DiagnosticStatus.ERROR
                text = f"{topic} has a second publisher: another {self.get_name()} is running"
                self.get_logger().error(text, throttle_duration_sec=5.0)
                break
        values = {**self.figures(), **self.counters}
        status = DiagnosticStatus(
            level=level,
            name=self.get_fully_qualified_name(),
            message=text,
            hardware_id="gda_tracker",
            values=[KeyValue(key=str(k), value=str(v)) for k, v in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)


def spin_node(make: Callable[[], Any], arguments: list[str] | None = None) -> int:
    """Run one node until it is told to stop, or until it says ``finished``; return the exit code.

    A wrong parameter ends with one line on standard error and exit code 2.
    """
    rclpy.init(args=arguments)
    node = None
    try:
        try:
            node = make()
        except ParameterError as error:
            print(str(error), file=sys.stderr)
            return 2
        executor = LeanExecutor()
        executor.add_node(node)
        node.autostart()
        # What start-up made stays: without this, every look for garbage goes through all of it, and
        # a scan of many tracks makes enough objects to ask for one.
        gc.collect()
        gc.freeze()
        gc.set_threshold(50_000)
        while rclpy.ok() and not getattr(node, "finished", False):
            # The timer of the diagnostics wakes this at least once a second.
            executor.spin_once()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        # SIGTERM can surface as a plain RCLError from the wait set; anything else is real.
        if rclpy.ok():
            raise
    finally:
        close = getattr(node, "close", None)
        if close is not None:
            close()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return int(getattr(node, "exit_code", 0))
