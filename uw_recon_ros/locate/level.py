"""Level ground where nothing says which way is down: the plane of the bottom laid flat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.locate.visual_odometry import Link
from uw_recon_ros.track.keypoints import RigError, points_of
from uw_recon_ros.types import Matrix, StereoGeometry


def levelled(
    poses: Matrix, parts: NDArray[np.int64], links: list[Link], geometry: StereoGeometry, rig: RigError
) -> Matrix:
    """Turn each part so that the plane through what it sees is z = 0, up towards the cameras, its first frame above 0.

    Parameters
    ----------
    poses : (N, 4, 4) float64
    parts : (N,) int64
    links : list of Link
        Their matches are what is seen.
    geometry : StereoGeometry
    rig : RigError
    """
    turned: Matrix = poses.copy()
    for number in np.unique(parts):
        points = _seen(poses, [link for link in links if parts[link.first] == number], geometry, rig)
        if len(points) < 100:
            continue
        where = np.flatnonzero(parts == number)
        turned[where] = _onto_plane(points, poses[where[0]]) @ poses[where]
    return turned


def _seen(poses: Matrix, links: list[Link], geometry: StereoGeometry, rig: RigError) -> Matrix:
    found = [np.zeros((0, 3))]
    for link in links:
        if link.relation.matches is not None and link.kind == "track":
            points = points_of(link.relation.matches.unpacked().first[::4], geometry, rig)
            found.append(points @ poses[link.first, :3, :3].T + poses[link.first, :3, 3])
    seen: Matrix = np.concatenate(found)
    return seen


def _onto_plane(points: Matrix, first: Matrix) -> Matrix:
    """World's new <- old frame."""
    middle = np.median(points, axis=0)
    up = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    if up @ (first[:3, 3] - middle) < 0:
        up = -up
    ahead = first[:3, 0] - up * (up @ first[:3, 0])
    x = ahead / np.linalg.norm(ahead)
    change = np.eye(4)
    change[:3, :3] = np.stack([x, np.cross(up, x), up])
    foot = first[:3, 3] - up * (up @ (first[:3, 3] - middle))
    change[:3, 3] = -change[:3, :3] @ foot
    return change
