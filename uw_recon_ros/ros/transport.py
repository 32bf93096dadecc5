"""Shared memory large enough for images, for Fast DDS.

Its default segment is 512 KiB; whatever is larger goes out in 64 KB pieces, which is slow where reliable and lost where
best effort. The remedy is a profile with a larger segment in the publishing process. It is named by an environment
variable, so it must be there before ``rclpy.init``; a profile the user has chosen is never replaced.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import MutableMapping
from pathlib import Path

import rclpy

from uw_recon_ros.ros.orphans import remove_orphans

_UP_TO_JAZZY, _SINCE_KILTED = "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"
CHOICES = (_UP_TO_JAZZY, _SINCE_KILTED, "FASTDDS_BUILTIN_TRANSPORTS", "ROS_DISCOVERY_SERVER")
#: Names the profile file here; the other one is not read, or only under protest.
PROFILE_VARIABLE = _SINCE_KILTED if hasattr(rclpy, "InitContextManager") else _UP_TO_JAZZY
_SHARED_MEMORY = Path("/dev/shm")
_MIB = 1 << 20
DEFAULT_SEGMENT = 64 * _MIB
_SMALLEST_SEGMENT = 4 * _MIB
#: How many processes of ours may have to share what is free: four stages, a player, and as many listeners.
_SHARERS = 8

_written: list[Path] = []

_PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>
    <transport_descriptors>
      <transport_descriptor>
        <transport_id>uw_recon_shm</transport_id>
        <type>SHM</type>
        <segment_size>{segment}</segment_size>
        <maxMessageSize>{segment}</maxMessageSize>
      </transport_descriptor>
      <transport_descriptor>
        <transport_id>uw_recon_udp</transport_id>
        <type>UDPv4</type>
      </transport_descriptor>
    </transport_descriptors>
    <participant profile_name="uw_recon" is_default_profile="true">
      <rtps>
        <userTransports>
          <transport_id>uw_recon_shm</transport_id>
          <transport_id>uw_recon_udp</transport_id>
        </userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>
      </rtps>
    </participant>
  </profiles>
</dds>
"""


def profile_xml(segment: int) -> str:
    """Write the Fast DDS profile: a segment of `segment` bytes of shared memory, and UDP."""
    return _PROFILE.format(segment=segment)


def fitting_segment(free: int, wanted: int = DEFAULT_SEGMENT) -> int:
    """How large a segment may be, bytes; 0: too little is free to gain anything.

    Parameters
    ----------
    free : int
        Free bytes of shared memory.
    wanted : int
        Bytes that would be best.
    """
    fitting = min(wanted, free // _SHARERS)
    return fitting if fitting >= _SMALLEST_SEGMENT else 0


def prepare(environment: MutableMapping[str, str] | None = None, wanted: int = DEFAULT_SEGMENT) -> str | None:
    """Name a profile with a large segment in the environment, unless the user has chosen otherwise.

    Call before ``rclpy.init``. Room that killed processes left taken is freed first.

    Parameters
    ----------
    environment : mapping
        ``os.environ`` by default.
    wanted : int
        Segment size, bytes.

    Returns
    -------
    str or None
        A warning to log, if shared memory is too small.
    """
    environment = os.environ if environment is None else environment
    if environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp") != "rmw_fastrtps_cpp":
        return None
    remove_orphans(_SHARED_MEMORY)
    if any(environment.get(variable) for variable in CHOICES):
        return None
    try:
        free = shutil.disk_usage(_SHARED_MEMORY).free
        segment = fitting_segment(free, wanted)
        path = _write_profile(segment) if segment else None
    except OSError as error:
        return f"shared memory: no larger segment for images ({error}): expect slow or lost images"
    if path is None:
        return (
            f"shared memory: expected at least {_SHARERS * _SMALLEST_SEGMENT // _MIB} MiB free in {_SHARED_MEMORY}, "
            f"got {free // _MIB} MiB: images go in 64 KB pieces, slow or lost (Docker: --shm-size or --ipc=host)"
        )
    environment.setdefault(PROFILE_VARIABLE, path)
    return None


def _write_profile(segment: int) -> str:
    """Write the profile to a file of our own that goes with the process; return its path."""
    descriptor, path = tempfile.mkstemp(prefix="uw_recon_fastdds_", suffix=".xml")
    with os.fdopen(descriptor, "w", encoding="ascii") as file:
        file.write(profile_xml(segment))
    _written.append(Path(path))
    return path


@atexit.register
def clean_up() -> None:
    """Remove the files written here; done at exit, called by those who leave by a shorter way."""
    while _written:
        _written.pop().unlink(missing_ok=True)
