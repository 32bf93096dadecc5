"""Recordings: read, judged, written. The only room that knows the bag libraries; it needs no ROS."""

from uw_recon_ros.bags.contents import BagInfo
from uw_recon_ros.bags.info import bag_info
from uw_recon_ros.bags.model import QosProfile, RawMessage, TopicInfo
from uw_recon_ros.bags.reader import BagReader, open_bag
from uw_recon_ros.bags.stereo import StereoTopics, find_stereo_topics
from uw_recon_ros.bags.writer import BagWriter, write_bag

__all__ = [
    "BagInfo",
    "BagReader",
    "BagWriter",
    "QosProfile",
    "RawMessage",
    "StereoTopics",
    "TopicInfo",
    "bag_info",
    "find_stereo_topics",
    "open_bag",
    "write_bag",
]
