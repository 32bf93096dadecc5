"""What Fast DDS is told: shared memory large enough for images, and to forget soon who was killed.

Its default segment is 512 KiB; whatever is larger goes out in 64 KB pieces, which is slow where reliable and lost where
best effort. The remedy is a profile with a larger segment in the publishing process. And who dies without a farewell is
remembered for the 20 s of its default lease: as long its topics have a publisher that is none. The profile is named by
an environment variable, so it must be there before ``rclpy.init``; a profile the user has chosen is never replaced.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import MutableMapping
from pathlib import Path

import rclpy

from uw_recon_ros.ros.fastdds_segments import remove_orphans

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

#: A participant announces itself that often, s; who has not been heard of for the lease is gone, its ends with it.
ANNOUNCEMENT_S, LEASE_S = 1, 4

_TRANSPORTS = """
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
    </transport_descriptors>"""
_USED = """
        <userTransports>
          <transport_id>uw_recon_shm</transport_id>
          <transport_id>uw_recon_udp</transport_id>
        </userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>"""
_PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>{transports}
    <participant profile_name="uw_recon" is_default_profile="true">
      <rtps>
        <builtin>
          <discovery_config>
            <leaseDuration><sec>{lease}</sec></leaseDuration>
            <leaseAnnouncement><sec>{announcement}</sec></leaseAnnouncement>
          </discovery_config>
        </builtin>{used}
      </rtps>
    </participant>
  </profiles>
</dds>
"""


def profile_xml(segment: int) -> str:
    """Write the Fast DDS profile: the lease, and a segment of `segment` bytes beside UDP (0: the transports it has)."""
    transports, used = (_TRANSPORTS.format(segment=segment), _USED) if segment else ("", "")
    return _PROFILE.format(transports=transports, used=used, lease=LEASE_S, announcement=ANNOUNCEMENT_S)


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
    """Name a profile with a large segment and a short lease in the environment, unless the user has chosen otherwise.

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
    segment, warning = _segment(wanted)
    try:
        environment.setdefault(PROFILE_VARIABLE, _write_profile(segment))
    except OSError as error:
        return f"Fast DDS: no profile could be written ({error}): expect slow or lost images"
    return warning


def _segment(wanted: int) -> tuple[int, str | None]:
    """Size of the segment, bytes (0: too little is free), and what is to be said of it."""
    try:
        free = shutil.disk_usage(_SHARED_MEMORY).free
    except OSError as error:
        return 0, f"shared memory: no larger segment for images ({error}): expect slow or lost images"
    if segment := fitting_segment(free, wanted):
        return segment, None
    return 0, (
        f"shared memory: expected at least {_SHARERS * _SMALLEST_SEGMENT // _MIB} MiB free in {_SHARED_MEMORY}, "
        f"got {free // _MIB} MiB: images go in 64 KB pieces, slow or lost (Docker: --shm-size or --ipc=host)"
    )


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
        path = _written.pop()
        if os.environ.get(PROFILE_VARIABLE) == str(path):  # no child may look for it
            del os.environ[PROFILE_VARIABLE]
        path.unlink(missing_ok=True)
