"""Quality of service: reliable both ways, best effort only where a publisher offers nothing else.

A best-effort subscription to big images loses all of them where the publisher has Fast DDS's default segment (see
`transport`); a reliable one is refused by a best-effort publisher. So subscriptions ask for reliable, and ask again for
best effort when the middleware reports an incompatible publisher. ``qos_overrides.*`` parameters change history, depth
and reliability of every topic; where reliability is set there, it is left alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

try:
    from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks, UnsupportedEventTypeError
except ImportError:  # Humble
    from rclpy.qos_event import PublisherEventCallbacks, SubscriptionEventCallbacks, UnsupportedEventTypeError

#: Messages kept by the middleware a topic. What is heavy to work on waits in a mailbox of one (`worker`); here there is
#: room for the partners of a pair to arrive in bursts.
DEPTH = 5


def profile(*, depth: int = DEPTH, reliable: bool = True, latched: bool = False) -> QoSProfile:
    """Make a keep-last profile.

    Parameters
    ----------
    depth : int
    reliable : bool
        Else best effort.
    latched : bool
        Transient local: late subscribers get the last message.
    """
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def advertise(
    node: Node, message_type: Any, topic: str, *, latched: bool = False, on_match: Callable[[], None] | None = None
) -> Publisher:
    """Create a reliable publisher.

    Parameters
    ----------
    node : Node
    message_type : type
    topic : str
    latched : bool
    on_match : callable or None
        Called whenever a subscriber comes or goes, where the middleware tells.
    """
    make = {
        "msg_type": message_type,
        "topic": topic,
        "qos_profile": profile(depth=1 if latched else DEPTH, latched=latched),
        "qos_overriding_options": QoSOverridingOptions.with_default_policies(),
    }
    if on_match is None:
        return node.create_publisher(**make)
    notify = on_match
    try:
        return node.create_publisher(**make, event_callbacks=PublisherEventCallbacks(matched=lambda _: notify()))
    except (TypeError, UnsupportedEventTypeError):  # Humble: whoever needs to know polls
        return node.create_publisher(**make)


class ReliableFirst:
    """A subscription that asks for reliable and falls back to best effort.

    Parameters
    ----------
    node : Node
    message_type : type
    topic : str
    callback : callable
        Called with each message.
    on_fallback : callable
        Called with one line of text when the fallback happens, or when it is ruled out by a parameter.
    on_match : callable
        Called whenever a publisher comes or goes, where the middleware tells.
    on_lost : callable
        Called with a number of messages that the middleware could not deliver.
    """

    def __init__(
        self,
        node: Node,
        message_type: Any,
        topic: str,
        callback: Callable[[Any], None],
        on_fallback: Callable[[str], None] = lambda text: None,
        on_match: Callable[[], None] = lambda: None,
        on_lost: Callable[[int], None] = lambda number: None,
    ) -> None:
        self._node, self._type, self._topic, self._callback = node, message_type, topic, callback
        self._on_fallback, self._on_match, self._on_lost = on_fallback, on_match, on_lost
        self.reliable = True
        self._subscription = self._subscribe()

    def destroy(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

    @property
    def publishers(self) -> int:
        """How many publishers the subscription has found; on Humble, how many are known on the topic."""
        if hasattr(self._subscription, "get_publisher_count"):
            return int(self._subscription.get_publisher_count())
        return int(self._node.count_publishers(self._node.resolve_topic_name(self._topic)))

    def _subscribe(self) -> Subscription:
        kinds = [QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH]
        if self.reliable:
            kinds.append(QoSPolicyKind.RELIABILITY)
        make = {
            "msg_type": self._type, "topic": self._topic, "callback": self._callback,
            "qos_profile": profile(reliable=self.reliable), "qos_overriding_options": QoSOverridingOptions(kinds),
        }  # fmt: skip
        told: dict[str, Any] = {
            "incompatible_qos": self._on_incompatible,
            "message_lost": lambda event: self._on_lost(event.total_count_change),
        }
        try:
            events = SubscriptionEventCallbacks(**told, matched=lambda _: self._on_match())
            return self._node.create_subscription(**make, event_callbacks=events)
        except (TypeError, UnsupportedEventTypeError):  # Humble: whoever needs to know polls
            return self._node.create_subscription(**make, event_callbacks=SubscriptionEventCallbacks(**told))

    def _on_incompatible(self, event: Any) -> None:
        resolved = self._node.resolve_topic_name(self._topic)
        if not self.reliable or event.last_policy_kind != QoSPolicyKind.RELIABILITY:
            self._on_fallback(f"{resolved}: a publisher offers incompatible QoS ({event.last_policy_kind})")
            return
        if f"qos_overrides.{resolved}.subscription.reliability" in self._node._parameter_overrides:
            self._on_fallback(f"{resolved}: a publisher offers best effort only, and qos_overrides demands reliable")
            return
        self._on_fallback(f"{resolved}: a publisher offers best effort only: large images may be lost")
        self.reliable = False
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe()
