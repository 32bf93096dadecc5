"""A segment that fits, and never against the user's will."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from uw_recon_ros.ros import fastdds

MIB = 1 << 20
NAME = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"


@pytest.mark.parametrize(
    ("free_mib", "expected_mib"), [(24_000, 64), (512, 64), (256, 32), (64, 8), (32, 4), (31, 0), (0, 0)]
)
def test_segment_fits_what_is_free(free_mib: int, expected_mib: int) -> None:
    assert fastdds.fitting_segment(free_mib * MIB) == expected_mib * MIB


def test_profile_has_shared_memory_and_udp_and_nothing_else() -> None:
    root = ElementTree.fromstring(fastdds.profile_xml(8 * MIB))
    described = {next(d.iter(f"{NAME}transport_id")).text: d for d in root.iter(f"{NAME}transport_descriptor")}
    assert {d.find(f"{NAME}type").text for d in described.values()} == {"SHM", "UDPv4"}  # type: ignore[union-attr]
    used = [e.text for e in root.iter(f"{NAME}userTransports") for e in e]
    assert set(used) == set(described)
    assert [e.text for e in root.iter(f"{NAME}segment_size")] == [str(8 * MIB)]
    assert [e.text for e in root.iter(f"{NAME}maxMessageSize")] == [str(8 * MIB)]
    assert [e.text for e in root.iter(f"{NAME}useBuiltinTransports")] == ["false"]


@pytest.mark.parametrize("segment", [0, 8 * MIB])
def test_who_was_killed_is_forgotten_soon_with_or_without_a_segment(segment: int) -> None:
    root = ElementTree.fromstring(fastdds.profile_xml(segment))
    lease, announcement = (
        float(next(root.iter(f"{NAME}{tag}")).findtext(f"{NAME}sec", "nan"))
        for tag in ("leaseDuration", "leaseAnnouncement")
    )
    assert 2 <= lease <= 5
    assert announcement <= lease / 3  # two may be lost
    assert bool(list(root.iter(f"{NAME}userTransports"))) == bool(segment)


def test_the_variable_names_a_file_that_goes_with_us() -> None:
    environment: dict[str, str] = {}
    assert fastdds.prepare(environment) is None
    path = Path(environment[fastdds.PROFILE_VARIABLE])
    assert "SHM" in path.read_text(encoding="ascii")
    fastdds.clean_up()
    assert not path.exists()


@pytest.mark.parametrize(
    "theirs",
    [
        {"FASTRTPS_DEFAULT_PROFILES_FILE": "/mine.xml"},
        {"FASTDDS_DEFAULT_PROFILES_FILE": "/mine.xml"},
        {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"},
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
    ],
)
def test_what_the_user_has_chosen_stays(theirs: dict[str, str]) -> None:
    environment = dict(theirs)
    assert fastdds.prepare(environment) is None
    assert environment == theirs


def test_too_little_shared_memory_is_said_and_survived(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fastdds, "_SHARERS", 10**9)
    environment: dict[str, str] = {}
    warning = fastdds.prepare(environment)
    assert warning is not None
    assert "/dev/shm" in warning
    assert "leaseDuration" in Path(environment[fastdds.PROFILE_VARIABLE]).read_text(encoding="ascii")


def test_no_shared_memory_at_all_is_said_and_survived(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fastdds, "_SHARED_MEMORY", Path("/nonexistent"))
    warning = fastdds.prepare({})
    assert warning is not None
    assert "nonexistent" in warning
