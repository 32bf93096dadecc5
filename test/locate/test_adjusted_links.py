"""Which relations bundle adjustment replaces: better ones where it knows more, none where it is deceived."""

from __future__ import annotations

import dataclasses

import numpy as np
from helpers.track_scenes import GEOMETRY, bottom, descriptors, motion, seen

from uw_recon_ros import rigid
from uw_recon_ros.locate.adjusted_links import adjusted_links
from uw_recon_ros.locate.visual_odometry import Link, VisualOdometry, first_poses
from uw_recon_ros.track.keypoints import RigError, packed
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.track.relate import RelativePose, relate
from uw_recon_ros.types import Matrix

COUNT, POINTS = 10, 400
POSES = np.array(
    [motion(0.06 * k, 0.02 * np.sin(k), 0.01 * k, 0.02 * np.cos(k), 0.01 * k, 0.03 * k) for k in range(COUNT)]
)


def walked(seed: int = 0, pixel: float = 0.1, sigma: float = 0.3) -> VisualOdometry:
    """Frame to frame over a made-up bottom."""
    rng = np.random.default_rng(seed)
    points, names = bottom(rng, POINTS), descriptors(rng, POINTS)
    off = np.outer(0.4 * np.sin(4 * points[:, 0]), [0, 0, 1])  # of disparities: such errors stay with the place
    views = [seen(points, pose, names, rng, pixel=pixel, sigma=sigma) for pose in POSES]
    frames = [dataclasses.replace(v, measured=v.measured + off) for v in views]
    links = []
    for k in range(COUNT - 1):
        relation = relate(frames[k], frames[k + 1], GEOMETRY, TrackParams())
        assert relation is not None
        links.append(Link(k, k + 1, relation, "track"))
    kept = [packed(frame, POINTS) for frame in frames]
    return VisualOdometry(list(range(COUNT)), kept, [GEOMETRY] * COUNT, [1.25] * COUNT, links)


def adjusted(walk: VisualOdometry, links: list[Link] | None = None) -> list[Link]:
    given = walk.links if links is None else links
    return adjusted_links(walk, first_poses(COUNT, given), given, np.full(COUNT, 1.0), RigError(), 0.35)


def missed_m(links: list[Link]) -> Matrix:
    true = [rigid.inverse(POSES[link.first]) @ POSES[link.second] for link in links]
    wrong = [link.relation.motion - there for link, there in zip(links, true, strict=True)]
    return np.linalg.norm(np.array(wrong)[:, :3, 3], axis=1)


def test_relations_are_made_better_and_surer() -> None:
    before, after = [], []
    for seed in range(4):
        walk = walked(seed)
        links = adjusted(walk)
        before.append(missed_m(walk.links).mean())
        after.append(missed_m(links).mean())
        for old, new in zip(walk.links, links, strict=True):
            assert np.trace(new.relation.covariance) < np.trace(old.relation.covariance)
            assert new.relation.matches is old.relation.matches
    assert np.mean(after) < 0.6 * np.mean(before)


def test_key_points_that_are_not_sharp_are_not_believed() -> None:
    """In mud they hang on snow and on the lamp's glow: in agreement with each other, and wrong together."""
    walk = walked(pixel=0.25, sigma=1.0)
    assert all(a.relation is b.relation for a, b in zip(adjusted(walk), walk.links, strict=True))


def test_what_contradicts_the_relations_is_not_believed() -> None:
    walk = walked()
    away = motion(0.004, 0.003, 0, 0, 0, 0)
    links = [dataclasses.replace(k, relation=moved(k.relation, away)) for k in walk.links]
    assert all(a.relation is b.relation for a, b in zip(adjusted(walk, links), links, strict=True))


def test_a_bridge_stays_as_it_is() -> None:
    walk = walked()
    links = [dataclasses.replace(link, kind="bridge") if link.first == 4 else link for link in walk.links]
    found = adjusted(walk, links)
    assert found[4] is links[4]
    assert found[0].relation is not links[0].relation


def moved(relation: RelativePose, by: Matrix) -> RelativePose:
    """As sure, and wrong."""
    return dataclasses.replace(relation, motion=relation.motion @ by, covariance=1e-6 * np.eye(6))
