#!/bin/sh
# Usage: tools/make_venv.sh DIR EXTRAS
# Make a virtual environment with the project in it. Where ROS 2 is sourced its own rclpy is used; elsewhere the
# wheels named by $ROS_WHEELS (default: jazzy) are installed.
set -eu
venv=$1 extras=$2

# Jazzy's and Kilted's wheels stand in for rclpy up to 3.12; on 3.13 everything but the nodes runs.
supported='import sys; raise SystemExit(not (3, 10) <= sys.version_info[:2] <= (3, 13))'
wheels='import sys; raise SystemExit(sys.version_info[:2] > (3, 12))'
python=
if [ -n "${AMENT_PREFIX_PATH:-}" ] && python3 -c 'import rclpy' 2>/dev/null; then
    echo "ROS 2 found: using its rclpy ($(python3 -c 'import rclpy; print(rclpy.__file__)'))"
    python=python3 site=--system-site-packages
else
    for candidate in ${PYTHON:-python3 python3.12 python3.11 python3.10 python3.13}; do
        if "$candidate" -c "$supported" 2>/dev/null; then python=$candidate; break; fi
    done
    if [ -z "$python" ]; then
        echo "make: expected Python 3.10 to 3.13 on PATH, got $(python3 --version 2>&1); name one: make PYTHON=..." >&2
        exit 1
    fi
    site=
    if "$python" -c "$wheels"; then
        extras=$extras,ros-${ROS_WHEELS:-jazzy}
        echo "no ROS 2 found: installing its wheels (${ROS_WHEELS:-jazzy}) into $venv"
    else
        echo "no ROS 2 found, and no wheels of it for $("$python" --version): the nodes and the demo do not run" >&2
    fi
fi

# The wheels' start-up hook marks the environment it runs in; another interpreter must not inherit the mark.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
if [ ! -x "$venv/bin/python" ]; then
    "$python" -m venv $site "$venv" || {
        echo "make: 'python3 -m venv' failed; on Debian and Ubuntu: apt install python3-venv" >&2
        exit 1
    }
fi
touch "$venv/COLCON_IGNORE"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --editable ".[$extras]"
touch "$venv/.ready"
