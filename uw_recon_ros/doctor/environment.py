"""Machine and middleware: is anything seen at all, is there room for images."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from uw_recon_ros.doctor.check import Check, fail, ok, warn
from uw_recon_ros.doctor.observation import Observation, Surroundings

_MIB = 1 << 20
#: Eight processes with the smallest segment of use, see `ros.fastdds`.
_SHM_NEEDED = 32 * _MIB
#: Zenoh's router listens there; its pool on Jazzy (later 48 MiB), and one that holds an organised cloud at 1280x720, a
#: second one on its way, and their images.
_ZENOH_PORT, _ZENOH_POOL, _ZENOH_POOL_NEEDED = 7447, 16 * _MIB, 64 * _MIB
_RECEIVE_NEEDED = 16 * _MIB  # of a socket: pieces of one pair's messages that wait to be read
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
    """Name the middleware, and what makes it lose or delay images."""
    around = seen.surroundings
    look = {"rmw_fastrtps_cpp": _fast_dds, "rmw_zenoh_cpp": _zenoh, "rmw_cyclonedds_cpp": _cyclone}.get(around.rmw)
    if look is not None:
        return look(around)
    return [ok("transport", f"{around.rmw}: nothing is known of it here")] if around.rmw else []


def _fast_dds(around: Surroundings) -> list[Check]:
    if around.profile:
        return [ok("transport", f"a Fast DDS profile is set: {around.profile}")]
    if around.shm_free_bytes is None:
        return []
    free = f"Fast DDS, {around.shm_free_bytes // _MIB} MiB free in /dev/shm"
    if around.shm_free_bytes < _SHM_NEEDED:
        advice = (
            "Docker: --shm-size=512m or --ipc=host; else remove what crashed processes left (ls /dev/shm/fastrtps_*)"
        )
        return [warn("transport", f"{free}: large images go in 64 KB pieces, slow or lost", advice)]
    return [ok("transport", f"{free}; camera drivers send through 512 KiB unless they are given a profile")]


def _zenoh(around: Surroundings) -> list[Check]:
    settings, found = around.zenoh, []
    chosen = [name for name in ("ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE") if settings.get(name)]
    if _ZENOH_PORT in around.tcp_ports:
        found.append(ok("transport", f"Zenoh, a router listens on port {_ZENOH_PORT}"))
    elif around.nodes_seen > 0:
        found.append(ok("transport", "Zenoh, no router on this machine, yet other nodes are seen"))
    elif chosen:
        found.append(ok("transport", f"Zenoh, no router on this machine; {', '.join(chosen)} may name another"))
    else:
        text = f"Zenoh without a router: nothing listens on port {_ZENOH_PORT}, so nodes do not find each other"
        found.append(fail("transport", text, "ros2 run rmw_zenoh_cpp rmw_zenohd"))
    return [*found, *_zenoh_pool(settings)]


def _zenoh_pool(settings: Mapping[str, str]) -> list[Check]:
    """Shared memory: off unless it is asked for, and then smaller by default than a cloud and its images."""
    if "shared_memory/enabled=true" not in settings.get("ZENOH_CONFIG_OVERRIDE", "").replace(" ", ""):
        if settings.get("ZENOH_SESSION_CONFIG_URI"):
            return []
        return [ok("shared memory", "off, as Zenoh's default is: images go by TCP; see docs/troubleshooting.md")]
    told = settings.get("ZENOH_SHM_ALLOC_SIZE", "")
    pool = int(told) if told.isdecimal() and int(told) > 0 else _ZENOH_POOL
    if pool < _ZENOH_POOL_NEEDED:
        text = f"Zenoh's pool is {pool // _MIB} MiB a process: what does not fit goes by TCP"
        return [warn("shared memory", text, f"ZENOH_SHM_ALLOC_SIZE={_ZENOH_POOL_NEEDED} for every node")]
    return [ok("shared memory", f"Zenoh's pool is {pool // _MIB} MiB a process")]


def _cyclone(around: Surroundings) -> list[Check]:
    if around.receive_bytes is None or around.receive_bytes >= _RECEIVE_NEEDED:
        return [ok("transport", "Cyclone DDS: images go by UDP through the loopback")]
    text = (
        f"Cyclone DDS: sockets receive {around.receive_bytes // 1024} KiB at most, less than an image: pieces are lost"
    )
    return [warn("transport", text, f"sudo sysctl -w net.core.rmem_max={_RECEIVE_NEEDED}")]
