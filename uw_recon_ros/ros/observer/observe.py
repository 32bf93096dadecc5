"""Joining a graph for some seconds, for `doctor`."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor

from uw_recon_ros.doctor.observation import Observation, Surroundings
from uw_recon_ros.doctor.topic_graph import PIPELINE, STAGES
from uw_recon_ros.ros import fastdds
from uw_recon_ros.ros.observer.probe import Probe

_SETTLED_S = 1.0
_LISTENING = "0A"  # of the states in /proc/net/tcp


def surroundings() -> Surroundings:
    """Describe machine and middleware; call before ``fastdds.prepare``, which sets a profile itself."""
    chosen = [os.environ[name] for name in fastdds.CHOICES if os.environ.get(name)]
    local = os.environ.get("ROS_LOCALHOST_ONLY") == "1"
    try:
        free = shutil.disk_usage("/dev/shm").free
    except OSError:
        free = None
    return Surroundings(
        domain=os.environ.get("ROS_DOMAIN_ID") or "0",
        discovery_range="LOCALHOST" if local else os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", ""),
        rmw=rclpy.utilities.get_rmw_implementation_identifier(),
        profile=chosen[0] if chosen else "",
        shm_free_bytes=free,
        udp_ports=_ports("udp"),
        tcp_ports=_ports("tcp", _LISTENING) + _ports("tcp6", _LISTENING),
        receive_bytes=_receive_bytes(),
        zenoh={name: value for name, value in os.environ.items() if name.startswith("ZENOH_")},
    )


def _ports(protocol: str, state: str = "") -> tuple[int, ...]:
    """Ports in use on this machine; none where the system does not tell."""
    try:
        lines = [line.split() for line in Path("/proc/net", protocol).read_text(encoding="ascii").splitlines()[1:]]
        return tuple(int(line[1].rsplit(":", 1)[1], 16) for line in lines if not state or line[3] == state)
    except (OSError, ValueError, IndexError):
        return ()


def _receive_bytes() -> int | None:
    try:
        return int(Path("/proc/sys/net/core/rmem_max").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def _busiest(nodes: Sequence[tuple[str, str]], here: str) -> str:
    """The name space with most of our stages; `here` among equals."""
    stages = Counter({here: 0})
    for name, space in nodes:
        stages[space] += len(STAGES) if name == PIPELINE else 1
    return max(sorted(stages), key=lambda space: (stages[space], space == here))


def observe(namespace: str | None, seconds: float, ros_args: Sequence[str] = ()) -> Observation:
    """Join the graph and watch it.

    Parameters
    ----------
    namespace : str or None
        Of the graph; None: where most of our nodes are.
    seconds : float
        How long at most; less where all is well.
    ros_args : sequence of str
        As after ``--ros-args``: remaps, ``__ns``.

    Returns
    -------
    Observation

    Raises
    ------
    ValueError
        A name space or ROS argument is none.
    """
    around = surroundings()
    fastdds.prepare()
    context = Context()
    try:
        rclpy.init(args=[], context=context)
        options: dict[str, Any] = {"context": context, "cli_args": ["--ros-args", *ros_args] if ros_args else None}
        probe = Probe(around, namespace=namespace or "", **options)
    except (RuntimeError, ValueError, NameValidationException) as error:
        rclpy.try_shutdown(context=context)
        raise ValueError(" ".join(str(error).split())) from error
    executor = SingleThreadedExecutor(context=context)
    fixed = namespace is not None or any("__ns:=" in argument for argument in ros_args)
    try:
        while _watch(executor, probe, seconds, may_stray=not fixed):
            space = _busiest(probe.our_nodes(), probe.get_namespace())
            probe.destroy_node()
            probe = Probe(around, namespace=space, **options)
        return probe.observation()
    finally:
        executor.shutdown()
        probe.destroy_node()
        rclpy.try_shutdown(context=context)


def _watch(executor: SingleThreadedExecutor, probe: Probe, seconds: float, *, may_stray: bool) -> bool:
    """Spin until clouds come, time is up, or most of our nodes turn out to be elsewhere: then return True."""
    executor.add_node(probe)
    try:
        while not probe.satisfied and probe.seconds < seconds:
            executor.spin_once(timeout_sec=0.1)
            if may_stray and probe.seconds > _SETTLED_S:
                here = probe.get_namespace()
                if _busiest(probe.our_nodes(), here) != here:
                    return True
        return False
    finally:
        executor.remove_node(probe)
