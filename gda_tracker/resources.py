"""Where parameter files, launch files, sample data and message definitions are.

The same relative paths hold in a source checkout and in the installed
``share/gda_tracker``: ``params/...``, ``launch/...``, ``data/...`` and
``msg_schemas/msg/...``.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

__all__ = ["resource", "share_directory"]

_PACKAGE = "gda_tracker"


def share_directory() -> Path:
    """Folder that holds the package's data files.

    The first of these that exists:

    1. the source checkout, when the package is imported from one
       (``package.xml`` lies next to the package folder);
    2. ``share/gda_tracker`` of the first prefix in ``AMENT_PREFIX_PATH`` whose
       ament index lists the package;
    3. ``share/gda_tracker`` of the prefix the imported package is installed in;
    4. ``share/gda_tracker`` below ``sys.prefix``.

    Returns
    -------
    pathlib.Path
        An existing folder.

    Raises
    ------
    FileNotFoundError
        If there is none; the message names every folder that was tried.
    """
    tried = []
    for candidate in _candidates():
        if (candidate / "package.xml").is_file():
            return candidate
        tried.append(candidate)
    listing = ", ".join(str(path) for path in tried)
    raise FileNotFoundError(f"the data files of {_PACKAGE} are in none of: {listing}")


def resource(*parts: str | os.PathLike[str]) -> Path:
    """Path of one data file or folder, for example ``resource("params", "basic.yaml")``.

    Parameters
    ----------
    *parts
        Path below `share_directory`, in one piece or several.

    Returns
    -------
    pathlib.Path
        An existing file or folder.

    Raises
    ------
    FileNotFoundError
        If it does not exist; the message names the path and what its folder holds.
    """
    path = share_directory().joinpath(*parts)
    if path.exists():
        return path
    if path.parent.is_dir():
        siblings = ", ".join(sorted(entry.name for entry in path.parent.iterdir()))
        raise FileNotFoundError(f"no resource {path}; its folder holds: {siblings or 'nothing'}")
    raise FileNotFoundError(f"no resource {path}; its folder does not exist")


def _candidates() -> Iterator[Path]:
    package = Path(__file__).resolve().parent
    yield package.parent
    for entry in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if entry:
            prefix = Path(entry)
            if (prefix / "share/ament_index/resource_index/packages" / _PACKAGE).is_file():
                yield prefix / "share" / _PACKAGE
    # <prefix>/lib/python3.x/site-packages/gda_tracker, whatever the depth.
    for prefix in package.parents[1:]:
        share = prefix / "share" / _PACKAGE
        if share.is_dir():
            yield share
    yield Path(sys.prefix) / "share" / _PACKAGE
