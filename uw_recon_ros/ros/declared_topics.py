"""How a node declares what it reads and what it publishes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from uw_recon_ros.ros.message_types import message_class
from uw_recon_ros.topics import find_topic, published_by


@dataclass(frozen=True)
class InputTopic:
    """A topic that may serve an input; `type` is None where its message package is not installed."""

    name: str
    type: Any


def input_topic(topic: str) -> InputTopic:
    """A topic of the table."""
    return InputTopic(topic, message_class(find_topic(topic).type))


@dataclass(frozen=True)
class Input:
    """Something a node needs.

    Parameters
    ----------
    name : str
        Under which a group holds its message.
    alternatives : tuple of InputTopic
        Alternatives; the first that has a publisher is taken.
    role : {'paired', 'optional', 'latest'}
        ``paired``: grouped by stamp. ``optional``: the same where it has a publisher, else done without. ``latest``:
        the newest message goes along, and is waited for where there is a publisher.
    """

    name: str
    alternatives: tuple[InputTopic, ...]
    role: Literal["paired", "optional", "latest"] = "paired"


@dataclass(frozen=True)
class Output:
    """A topic that a node publishes.

    Parameters
    ----------
    topic : str
    type : type
        Message class.
    latched : bool
        Whether late subscribers get the last message.
    quiet : bool
        Whether its listeners are no reason to work, for they listen to other nodes too; see `Outputs.tell`.
    """

    topic: str
    type: Any
    latched: bool = False
    quiet: bool = False


def outputs_of(node: str) -> tuple[Output, ...]:
    """What the table says that a stage node publishes."""
    return tuple(Output(topic.name, message_class(topic.type), topic.latched) for topic in published_by(node))
