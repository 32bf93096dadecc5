"""Machine and middleware: is anything seen at all, is there room for images."""

from __future__ import annotations

from collections.abc import Iterable

from uw_recon_ros.doctor.check import Check, fail, ok, warn
from uw_recon_ros.doctor.observation import Observation, Surroundings

_MIB = 1 << 20
#: Eight processes with the smallest segment of use, see `ros.fastdds`.
_SHM_NEEDED = 32 * _MIB
_FIRST_PORT, _PORTS_A_DOMAIN, _LAST_DOMAIN = 7400, 250, 101


def _settings(around: Surroundings) -> str:
    said = f"ROS_DOMAIN_ID {around.domain}, {around.rmw}"
    return said + (f", discovery range {around.discovery_range}" if around.discovery_range else "")


def domains_at_work(ports: Iterable[int]) -> list[int]:
    """Guess the ROS domains of this machine from UDP ports in use: DDS takes 7410 + 250 domain and up (RTPS 9.6.2)."""
    places = (divmod(port - _FIRST_PORT, _PORTS_A_DOMAIN) for port in ports if port >= _FIRST_PORT)
    return sorted({domain for domain, offset in places if domain <= _LAST_DOMAIN and 10 <= offset < 50})


def check_discovery(seen: Observation) -> list[Check]:
    """See whether any other node is there."""
    around = seen.surroundings
    if around.nodes_seen > 0:
        elsewhere = f"; also {', '.join(seen.elsewhere)} (see them with --namespace)" if seen.elsewhere else ""
        return [ok("discovery", f"{around.nodes_seen} other nodes ({_settings(around)}){elsewhere}")]
    domains = [domain for domain in domains_at_work(around.udp_ports) if str(domain) != around.domain]
    if domains:
        others = ", ".join(map(str, domains))
        text = f"no other node is seen ({_settings(around)}), but DDS is at work in domain {others} on this machine"
        return [fail("discovery", text, f"ROS_DOMAIN_ID={domains[0]} uw_recon doctor")]
    advice = "start the graph; else compare ROS_DOMAIN_ID and RMW_IMPLEMENTATION on both sides"
    if around.discovery_range == "LOCALHOST":
        advice += "; ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST sees this machine only"
    elif around.discovery_range == "OFF":
        advice = "unset ROS_AUTOMATIC_DISCOVERY_RANGE: OFF sees nothing"
    else:
        advice += ", and whether the network carries multicast (Docker: --net=host --ipc=host)"
    return [fail("discovery", f"no other node is seen ({_settings(around)})", advice)]


def check_transport(seen: Observation) -> list[Check]:
    """See whether shared memory has room for images."""
    around = seen.surroundings
    if around.rmw != "rmw_fastrtps_cpp":
        return []
    if around.profile:
        return [ok("transport", f"a Fast DDS profile is set: {around.profile}")]
    if around.shm_free_bytes is None:
        return []
    free = f"{around.shm_free_bytes // _MIB} MiB free in /dev/shm"
    if around.shm_free_bytes < _SHM_NEEDED:
        advice = (
            "Docker: --shm-size=512m or --ipc=host; else remove what crashed processes left (ls /dev/shm/fastrtps_*)"
        )
        return [warn("transport", f"{free}: large images go in 64 KB pieces, slow or lost", advice)]
    return [ok("transport", free)]
