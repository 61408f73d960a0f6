"""Multi-target radar tracking with generalised data association."""

from __future__ import annotations

__all__ = ["__version__"]


def _version() -> str:
    """Version of the imported code: of the source checkout, else of the installation.

    A checkout is asked first, so that an older installation in the same
    environment cannot lend its number to the newer code.
    """
    from importlib import metadata
    from pathlib import Path
    from xml.etree import ElementTree

    manifest = Path(__file__).resolve().parent.parent / "package.xml"
    if manifest.is_file():
        version = ElementTree.parse(manifest).findtext("version")
        if version:
            return version.strip()
    try:
        return metadata.version("gda_tracker")
    except metadata.PackageNotFoundError:
        return "0+unknown"


__version__ = _version()
