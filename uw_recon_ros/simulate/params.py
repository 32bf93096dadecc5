"""What can be chosen about a simulated dive."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.params import Params, param

SCENES = ("amphora", "pipe", "reef", "plane", "wreck")
WATERS = ("clear", "I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C", "9C")

DEAD_CHANNELS = ("none", "red", "green", "blue")
TRACKS = ("line", "lawnmower", "orbit", "return")
BOTTOMS = ("objects", "relief", "flat", "ripples", "tiles")

#: What `SimulateParams` are on a track unless they are given.
ON_A_TRACK: dict[str, object] = {"frames": 60, "speed_m_s": 0.3, "distance_m": 1.25, "pitch_deg": 90.0}
_ORBIT_PITCH_DEG = 45.0


@dataclass(frozen=True)
class SimulateParams(Params):
    """A short dive over a seabed, seen by a stereo rig. The same parameters give the same bytes."""

    seed: int = param(1, "Everything random follows from it.", low=0, high=2**31 - 1)
    frames: int = param(6, "Stereo pairs to take.", low=1, high=100_000)
    rate_hz: float = param(2.0, "Pairs per second.", unit="Hz", low=0.01, high=1000.0)
    speed_m_s: float = param(0.08, "Speed of the rig along its track.", unit="m/s", low=0.0, high=5.0)

    scene: str = param("amphora", "What lies on the seabed; plane is a flat one.", choices=SCENES)
    texture: str = param("rich", "Contrast of all surfaces; weak is mud.", choices=("rich", "weak"))
    distance_m: float = param(1.3, "From the rig to the middle of the scene.", unit="m", low=0.3, high=20.0)
    pitch_deg: float = param(
        42.0, "Angle at which the rig looks down; 90 is straight.", unit="deg", low=15.0, high=90.0
    )

    look_up_deg: float = param(
        0.0, "The cameras are tilted up by this against the pitch: the upper part of the view is open water.",
        unit="deg", low=0.0, high=60.0,
    )  # fmt: skip
    fish: int = param(0, "Fish that swim before the scene.", low=0, high=50)
    surface_above: bool = param(False, "Whether rays that lead up end at waves, seen from below.")
    other_lamps: int = param(0, "Lamps of others that shine into the cameras.", low=0, high=20)

    width: int = param(640, "Image width.", unit="px", low=16, high=8192)
    height: int = param(480, "Image height.", unit="px", low=16, high=8192)
    fov_deg: float = param(62.0, "Horizontal field of view in water.", unit="deg", low=10.0, high=110.0)
    axis: str = param("horizontal", "Direction of the baseline; vertical has the second camera below.",
                      choices=("horizontal", "vertical"))  # fmt: skip
    baseline_m: float = param(0.12, "Distance between the cameras.", unit="m", low=0.005, high=2.0)
    misalignment_deg: float = param(0.7, "Misalignment of the two cameras.", unit="deg", low=0.0, high=5.0)
    distortion: float = param(0.12, "Barrel distortion of the lenses, -k1; less than 0 is that of a flat port.",
                              low=-0.7, high=0.3)  # fmt: skip
    lens_blur_px: float = param(0.5, "Blur of lens and pixel, standard deviation.", unit="px", low=0.0, high=10.0)
    calibrated: bool = param(True, "Whether the bag tells the calibration.")

    water: str = param("3C", "Jerlov water type; clear is none at all.", choices=WATERS)
    turbidity: float = param(1.0, "Multiplies attenuation and scattering.", low=0.0, high=20.0)
    water_depth_m: float = param(
        5.0, "Below the surface, where daylight has lost colour.", unit="m", low=0.0, high=100.0
    )
    daylight: float = param(0.35, "Daylight at the surface relative to the lamp's at 1 m.", low=0.0, high=100.0)
    lamp: float = param(1.0, "Power of the rig's lamp.", low=0.0, high=100.0)
    forward_scatter_px_m: float = param(0.25, "Blur for every metre of type 3C water, standard deviation.", unit="px/m",
                                        low=0.0, high=10.0)  # fmt: skip
    snow_per_m3: float = param(250.0, "Drifting particles.", unit="1/m3", low=0.0, high=10_000.0)

    caustics: float = param(0.0, "Net of light that waves make of daylight; 1 is as strong as the light.", low=0.0,
                            high=1.0)  # fmt: skip
    port_dirt: float = param(0.0, "Spots and scratches on either port, at the same pixels in all pairs; 1 is opaque.",
                             low=0.0, high=1.0)  # fmt: skip

    exposure_ms: float = param(0.0, "Time of exposure: what moves in it is smeared.", unit="ms", low=0.0, high=1000.0)
    readout_ms: float = param(0.0, "Rolling shutter: from the first row to the last; the truth is of the first row.",
                              unit="ms", low=0.0, high=1000.0)  # fmt: skip
    dead_channel: str = param("none", "A channel that is 0 everywhere.", choices=DEAD_CHANNELS)
    letterbox_share: float = param(0.0, "Share of the rows that are black above, and below.", low=0.0, high=0.3)
    noise: float = param(1.0, "Sensor noise; 1 is a small camera at moderate gain.", low=0.0, high=20.0)
    gain_difference: float = param(0.0, "How much brighter the right camera is.", low=-0.9, high=9.0)
    bits: int = param(8, "Of a colour channel: 8 or 16.", low=8, high=16)
    mono: bool = param(False, "Whether the cameras see no colour.")

    def check_together(self) -> None:
        """8 or 16 bits; the rig must fit before the scene; what sees no colour has no channel to lose."""
        if self.mono and self.dead_channel != "none":
            raise ValueError(f"dead_channel: expected none with mono, got {self.dead_channel}")
        if self.bits not in (8, 16):
            raise ValueError(f"bits: expected 8 or 16, got {self.bits}")
        if self.distance_m < 2 * self.baseline_m:
            raise ValueError(
                f"distance_m: expected at least twice baseline_m = {self.baseline_m} m, got {self.distance_m}"
            )


def defaults_on(track: str) -> dict[str, object]:
    """Values of `SimulateParams` that suit a track: an orbit looks at its middle, the others straight down."""
    return ON_A_TRACK | ({"pitch_deg": _ORBIT_PITCH_DEG} if track == "orbit" else {})


@dataclass(frozen=True)
class CourseParams(Params):
    """A dive along a track. Together with `SimulateParams` the same parameters give the same bytes."""

    track: str = param("lawnmower", "Shape of the track.", choices=TRACKS)
    bottom: str = param("objects", "What is swum over; tiles and ripples repeat themselves.", choices=BOTTOMS)
    leg_m: float = param(3.0, "Length of a straight leg of lawnmower and return.", unit="m", low=0.1, high=1000.0)
    spacing_m: float = param(0.6, "Between neighbouring legs.", unit="m", low=0.05, high=100.0)
    heading_swing_deg: float = param(0.0, "Slow swing of the heading to either side.", unit="deg", low=0.0, high=90.0)
    altitude_swing_m: float = param(0.0, "Slow change of altitude up and down.", unit="m", low=0.0, high=10.0)

    dropped_share: float = param(0.0, "Share of pairs that never arrive.", low=0.0, high=0.9)
    blackout_m: float = param(0.0, "Stretch in the middle of the track without any pair.", unit="m", low=0.0,
                              high=1000.0)  # fmt: skip
    blurred_share: float = param(0.0, "Share of pairs smeared by motion.", low=0.0, high=1.0)
    blur_px: float = param(12.0, "Length of that smear.", unit="px", low=0.0, high=200.0)
    exposure_step: float = param(0.0, "Jump of the exposure every tenth pair: 0.5 is half as bright again.",
                                 low=0.0, high=4.0)  # fmt: skip
    movers: int = param(0, "Animals that crawl over the bottom.", low=0, high=50)

    told_disparity_offset_px: float = param(
        0.0, "Error of the disparity by the calibration in the bag.", unit="px", low=-20.0, high=20.0
    )
    told_focal_percent: float = param(0.0, "Error of the focal length in the bag.", unit="%", low=-20.0, high=20.0)
    sensors: bool = param(True, "Whether the bag holds IMU, pressure, DVL and GNSS.")
