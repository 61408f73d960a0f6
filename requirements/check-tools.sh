#!/bin/sh
# Checks that this machine can build the environment, and prints the Python to use.
#
# Everything that is missing is reported at once, on stderr, with exit status 1.
# PYTHON names the preferred interpreter; without it, python3 and then python3.x are tried.
set -eu

problems=""
problem() {
    problems="${problems}  - $1
"
}

usable() {
    "$1" -c 'import sys; sys.exit(not ((3, 11) <= sys.version_info[:2] <= (3, 14)))' 2>/dev/null
}

if [ "$(uname -s)" != Linux ] || [ "$(uname -m)" != x86_64 ]; then
    problem "platform $(uname -s) $(uname -m): the ROS 2 wheels exist for Linux x86_64 only.
    On another platform install ROS 2 Jazzy and build with colcon, see README.md."
fi

python=""
for candidate in ${PYTHON:-python3 python3.12 python3.13 python3.11 python3.14}; do
    if usable "$candidate"; then
        python=$candidate
        break
    fi
done
if [ -z "$python" ]; then
    found=$("${PYTHON:-python3}" --version 2>/dev/null || echo none)
    problem "Python 3.11 to 3.14 (found: $found). Choose one with: make PYTHON=/path/to/python3"
else
    "$python" -c 'import ensurepip, venv' 2>/dev/null ||
        problem "the venv module of $python (Debian and Ubuntu: apt install python3-venv)"
    "$python" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' ||
        problem "the C headers of $python (Debian and Ubuntu: apt install python3-dev)"
fi

for compiler in "${CC:-gcc}" "${CXX:-g++}"; do
    # CC and CXX may carry arguments.
    command -v "${compiler%% *}" >/dev/null ||
        problem "$compiler (Debian and Ubuntu: apt install g++)"
done

if ! command -v cmake >/dev/null; then
    problem "cmake 3.21 or newer (Debian and Ubuntu: apt install cmake; or: pip install cmake)"
else
    version=$(cmake --version | sed -n '1s/[^0-9]*\([0-9.]*\).*/\1/p')
    oldest=$(printf '%s\n3.21\n' "$version" | sort -V | head -n 1)
    [ "$oldest" = 3.21 ] || problem "cmake 3.21 or newer (found: $version; try: pip install cmake)"
fi

if [ -n "$problems" ]; then
    printf 'This machine cannot build the environment. Missing or unsuitable:\n%s' "$problems" >&2
    exit 1
fi
command -v "$python"
