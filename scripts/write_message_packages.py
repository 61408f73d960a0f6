#!/usr/bin/env python3
"""Write the message packages of others that gda_tracker knows, ready to be built with CMake.

python scripts/write_message_packages.py FOLDER

For environments without a ROS installation, which has them as packages; `make messages` calls it.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from gda_tracker.io.foreign_types import ALL_MESSAGES, definition, package_of  # noqa: E402

MANIFEST = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>0.0.0</version>
  <description>Messages of {name}, as far as gda_tracker reads and writes them.</description>
  <maintainer email="gda-tracker@example.org">gda_tracker developers</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
{depends}
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""
BUILD = """cmake_minimum_required(VERSION 3.16)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
# For Python alone: half of the work.
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
{finds}
rosidl_generate_interfaces(${{PROJECT_NAME}}
  {files}
  DEPENDENCIES {depends})
ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""


def dependencies(kinds: list[str], own: str) -> list[str]:
    """Packages that the fields of some types are of."""
    words = (line.split()[0] for kind in kinds for line in definition(kind).splitlines())
    return sorted({word.split("/")[0] for word in words if "/" in word} - {own})


def main(folder: str) -> int:
    """Write them below ``folder``; files that are the same already keep their time."""
    for name in sorted({package_of(kind) for kind in ALL_MESSAGES}):
        kinds = [kind for kind in ALL_MESSAGES if package_of(kind) == name]
        depends = dependencies(kinds, name)
        files = {f"msg/{kind.split('/')[-1]}.msg": definition(kind) for kind in kinds}
        content = {
            **files,
            "package.xml": MANIFEST.format(
                name=name, depends="\n".join(f"  <depend>{d}</depend>" for d in depends)
            ),
            "CMakeLists.txt": BUILD.format(
                name=name,
                finds="\n".join(f"find_package({d} REQUIRED)" for d in depends),
                files=" ".join(files),
                depends=" ".join(depends),
            ),
        }
        for relative, text in content.items():
            path = Path(folder) / name / relative
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists() or path.read_text() != text:
                path.write_text(text)
        print(name)
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1]))
