"""Observations to judge: a healthy graph, and ways to spoil it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from uw_recon_ros.doctor.observation import (
    Arrivals,
    CameraNumbers,
    Endpoint,
    GraphNode,
    NodeStatus,
    Observation,
    ObservedTopic,
    Surroundings,
)
from uw_recon_ros.doctor.topic_graph import CHAIN, TYPES
from uw_recon_ros.topics import IMAGE

SECOND = 1_000_000_000
MAKERS = {
    "left/image_matching": "/preprocess_node",
    "rectified/left/image_rect": "/rectify_node",
    "disparity": "/disparity_node",
    "points2": "/point_cloud_node",
}
STAMPS = tuple(range(SECOND, 6 * SECOND, SECOND // 10))


def numbers(tx: float = 0.0, **changes: Any) -> CameraNumbers:
    k = (400.0, 0.0, 320.0, 0.0, 400.0, 240.0, 0.0, 0.0, 1.0)
    p = (400.0, 0.0, 320.0, tx, 0.0, 400.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    side = CameraNumbers(640, 480, k, (0.0,) * 5, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), p)
    return replace(side, **changes)


def images(stamps: tuple[int, ...] = STAMPS, **changes: Any) -> Arrivals:
    came = Arrivals(
        count=len(stamps), rate_hz=10.0, stamps_ns=stamps, behind_ns=20_000_000, width=640, height=480,
        encoding="bgr8", size_bytes=640 * 480 * 3, frame_id="left_optical",
    )  # fmt: skip
    return replace(came, **changes)


def topic(name: str, maker: str | None = None, came: Arrivals | None = None, **ends: Any) -> ObservedTopic:
    publishers = (Endpoint(maker, TYPES[name]),) if maker else ()
    return ObservedTopic(f"/{name}", **{"publishers": publishers, "arrivals": came or Arrivals(), **ends})


def node(name: str, **changes: Any) -> GraphNode:
    values = {"in groups [Hz]": "10.00", "density": "0.91"}
    parameters = {"use_sim_time": False, "pair_tolerance_ms": 1.0}
    return replace(
        GraphNode(f"/{name}", parameters=parameters, statuses=(NodeStatus(0, "working", values),)), **changes
    )


def healthy() -> Observation:
    """Cameras with a calibration, four nodes, metric clouds, RViz listening."""
    topics = {name: topic(name) for name in TYPES}
    for side in ("left", "right"):
        topics[f"{side}/image_raw"] = topic(f"{side}/image_raw", "/driver", images())
        topics[f"{side}/camera_info"] = topic(f"{side}/camera_info", "/driver", Arrivals(50, 10.0, STAMPS))
    for name, maker in MAKERS.items():
        topics[name] = topic(name, maker, images(frame_id="left_optical", valid_share=0.9))
    topics["points2"] = replace(topics["points2"], subscribers=(Endpoint("/rviz2", TYPES["points2"]),))
    return Observation(
        seconds=5.0,
        topics=topics,
        nodes={name: node(name) for name in CHAIN if name != "pipeline_node"},
        infos={"left": numbers(), "right": numbers(-40.0)},
        surroundings=Surroundings("7", rmw="rmw_fastrtps_cpp", shm_free_bytes=1 << 30, nodes_seen=6),
    )


def change(seen: Observation, **topics: Any) -> Observation:
    """Put other topics in place of the chain's; keys with __ for /."""
    return replace(seen, topics={**seen.topics, **{name.replace("__", "/"): t for name, t in topics.items()}})


def spoil(seen: Observation, relative: str, **fields: Any) -> Observation:
    """Change fields of one topic."""
    return replace(seen, topics={**seen.topics, relative: replace(seen.topics[relative], **fields)})


def without_clouds(seen: Observation, since: int = 0) -> Observation:
    """What follows when a stage gives nothing: neither it nor those after it do; the rest waits."""
    for name in list(MAKERS)[since:]:
        seen = spoil(seen, name, arrivals=Arrivals())
    waiting = (NodeStatus(1, "waiting for something", {"silent": "waiting for something"}),)
    later = list(seen.nodes)[since + (since > 0) :]
    nodes = {name: replace(n, statuses=waiting) if name in later else n for name, n in seen.nodes.items()}
    return replace(seen, nodes=nodes)


def with_node(seen: Observation, name: str, **changes: Any) -> Observation:
    return replace(seen, nodes={**seen.nodes, name: replace(seen.nodes[name], **changes)})


def published(name: str, kind: str = IMAGE, maker: str = "/driver") -> ObservedTopic:
    return ObservedTopic(name, publishers=(Endpoint(maker, kind),))
