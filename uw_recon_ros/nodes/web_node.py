"""`web_node`: a page on the vehicle that shows state and pictures, for a browser, a telephone, BlueOS.

Serves, read only: the page at ``/``; ``/state``, what ``/diagnostics`` says of each node; ``/picture/NAME``, the newest
picture as JPEG; ``/register_service``, by which BlueOS finds the page. A picture's topic is subscribed to only while a
browser asks for it, so that a page nobody looks at makes no node work.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.utilities import remove_ros_args

from uw_recon_ros import stop_signals
from uw_recon_ros.nodes.web_server import PICTURES, Seen, serve
from uw_recon_ros.ros.message_types import message_class
from uw_recon_ros.ros.parameters import ParameterError
from uw_recon_ros.ros.process import DONE, FAILED, USAGE, leave, start, until_shutdown
from uw_recon_ros.ros.qos import profile
from uw_recon_ros.topics import find_topic

PORT = 8011  # none that BlueOS's own services have
_REFRESH_S = 0.25


class WebNode(Node):  # type: ignore[misc]
    """Hears what the page shows.

    Parameters
    ----------
    seen : Seen
        Where it leaves what it hears.
    options
        Passed to ``rclpy.node.Node``.
    """

    def __init__(self, seen: Seen, **options: Any) -> None:
        super().__init__("web_node", **options)
        self._seen, self._subscribed = seen, dict[str, Subscription]()
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 50)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_REFRESH_S, self._follow_the_page, clock=steady)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self._seen.status(status.name, status.level[0], status.message, values)

    def _follow_the_page(self) -> None:
        """Listen to the pictures that are asked for."""
        for name, topic in PICTURES.items():
            wanted = self._seen.asked(name)
            if wanted and name not in self._subscribed:
                kind, take = message_class(find_topic(topic).type), partial(self._seen.picture, name)
                self._subscribed[name] = self.create_subscription(kind, topic, take, profile(depth=1, reliable=False))
            elif not wanted and name in self._subscribed:
                self.destroy_subscription(self._subscribed.pop(name))


def _parse(args: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="web_node", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--port", type=int, default=PORT, help="0: any that is free (default %(default)s)")
    parser.add_argument("--address", default="0.0.0.0", help="127.0.0.1: this computer only (default: all)")
    return parser.parse_args(remove_ros_args(sys.argv if args is None else ["", *args])[1:])


def main(args: Sequence[str] | None = None) -> int:
    """Serve until interrupted; return the exit code."""
    code, node, server = DONE, None, None
    try:
        with until_shutdown():
            settings = _parse(args)
            start(args)
            seen = Seen()
            node, executor = WebNode(seen), SingleThreadedExecutor()
            executor.add_node(node)
            server = serve(seen, settings.address, settings.port)
            node.get_logger().info(f"a page with state and pictures: http://{settings.address}:{server.server_port}/")
            while not stop_signals.came():
                executor.spin_once()
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        code = USAGE
    except ExternalShutdownException:
        pass
    except (OSError, OverflowError) as error:
        asked, reason = f"{settings.address}:{settings.port}", getattr(error, "strerror", None) or str(error)
        text = f"error: --address, --port: expected ones that are free, got {asked}: {reason}"
        print(text, file=sys.stderr)  # noqa: T201
        code = FAILED
    if server is not None:
        server.shutdown()
        server.server_close()
    if node is not None:
        node.destroy_node()
    return leave(code)


if __name__ == "__main__":
    sys.exit(main())
