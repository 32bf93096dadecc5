"""Bags: read and written. The only room that knows the bag libraries; it needs no ROS."""

from uw_recon_ros.bags.model import QosProfile, RawMessage, TopicInfo
from uw_recon_ros.bags.reader import BagReader, open_bag
from uw_recon_ros.bags.stereo import StereoTopics, find_stereo_topics
from uw_recon_ros.bags.writer import BagWriter, write_bag

__all__ = [
    "BagReader",
    "BagWriter",
    "QosProfile",
    "RawMessage",
    "StereoTopics",
    "TopicInfo",
    "find_stereo_topics",
    "open_bag",
    "write_bag",
]
