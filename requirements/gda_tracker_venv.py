"""Start-up of the project's virtual environment, imported by ``gda_tracker_venv.pth``.

The ROS 2 wheels bring a start-up file of their own, which sets
``LD_LIBRARY_PATH`` and executes the interpreter again, once, guarded by the
variable ``_ROS_WHEELS_BOOTSTRAP_COMPLETE``. A process that inherits the guard
but not this environment's library path (a child with a cleaned environment, or
one started from another environment) would then fail to import rclpy. This
module runs before it and withdraws such a guard.

It also makes this environment an ament prefix without sourcing a set-up file.
Only the standard library is used, and little of it: this runs at each start.
"""

import os
import sys

_GUARD = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
_STARTED = "_GDA_TRACKER_VENV_PID"


def _join_ament_prefix_path() -> None:
    # Last: a workspace the user has sourced lies over this environment.
    entries = [e for e in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if e]
    if sys.prefix not in entries:
        os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join([*entries, sys.prefix])


def _withdraw_foreign_guard() -> None:
    libraries = os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    if os.path.join(sys.prefix, "lib") in libraries:
        return
    # The process keeps its id when it executes itself again. If the library path
    # did not survive that (file capabilities, for example), do not try for ever.
    process = str(os.getpid())
    if os.environ.get(_STARTED) != process:
        os.environ[_STARTED] = process
        os.environ.pop(_GUARD, None)


_join_ament_prefix_path()
_withdraw_foreign_guard()
