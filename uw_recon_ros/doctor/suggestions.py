"""Topics that were probably meant: the same name in another name space, or another spelling of the same camera."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from uw_recon_ros.doctor.observation import ObservedTopic
from uw_recon_ros.doctor.topic_graph import TYPES
from uw_recon_ros.topics import SIDES, TRANSPORTS, image_topics

#: How drivers name a camera.
_SPELLINGS = {
    "left": frozenset({"left", "l", "infra1", "cam0", "camera0", "upper"}),
    "right": frozenset({"right", "r", "infra2", "cam1", "camera1", "lower"}),
}
#: Earlier is likelier; a rectified image is the last resort.
_LIKELY = ("raw", "color", "mono", "rect")
_WORD = re.compile(r"[^/_]+")


def says_side(name: str, side: str) -> bool:
    """Whether a topic's name speaks of this camera and not of the other."""
    words = set(_WORD.findall(name.lower()))
    other = SIDES[1 - SIDES.index(side)]
    return bool(words & _SPELLINGS[side]) and not words & _SPELLINGS[other]


def same_elsewhere(relative: str, kinds: Iterable[str], others: Iterable[ObservedTopic]) -> list[str]:
    """Topics of the same relative name in other name spaces, published with one of `kinds`."""
    wanted = set(kinds)
    return sorted(t.name for t in others if t.name.endswith(f"/{relative}") and t.types & wanted)


def for_image(side: str, others: Iterable[ObservedTopic]) -> list[str]:
    """Topics that may be a camera's image, likeliest first."""
    found = [t.name for t in others if t.types & set(TRANSPORTS.values()) and says_side(t.name, side)]
    return sorted(found, key=_rank)


def _rank(name: str) -> tuple[int, int, str]:
    last = next((place for place, word in enumerate(_LIKELY) if word in name.rsplit("image", 1)[-1]), len(_LIKELY))
    return last, len(name), name


def namespace_of(name: str, relative: str) -> str:
    """What stands before the relative part of a resolved name, ``/`` at least."""
    return name.removesuffix(relative).rstrip("/") or "/"


def actual_names(subscriptions: Mapping[str, str], resolved: Mapping[str, str]) -> dict[str, str]:
    """Find out how our nodes' inputs were remapped from what they subscribe to.

    Parameters
    ----------
    subscriptions : mapping
        Topic to type, of the nodes that read the cameras.
    resolved : mapping
        The chain's relative names to those the doctor takes them for.

    Returns
    -------
    dict
        Relative names of camera topics to the actual ones, where these differ.
    """
    found: dict[str, str] = {}
    known = set(resolved.values())
    for side in SIDES:
        for relatives in (image_topics(side), (f"{side}/camera_info",)):
            if any(resolved[relative] in subscriptions for relative in relatives):
                continue
            for relative in relatives:
                foreign = [
                    name
                    for name, kind in subscriptions.items()
                    if kind == TYPES[relative] and name not in known and says_side(name, side)
                ]
                if len(foreign) == 1:
                    found[relative] = foreign[0]
    return found
