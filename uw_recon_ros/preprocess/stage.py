"""The preprocessing stage: from raw images to one to look at and one to match.

Top-down as section 2.1. Step 3 comes before step 2 where that makes no difference to any pixel: only Y is extended.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from uw_recon_ros.params import Params, param
from uw_recon_ros.preprocess import wavelet
from uw_recon_ros.preprocess.appearance import improve_appearance
from uw_recon_ros.preprocess.color import (
    apply_gains,
    equalizing_gains,
    luminance,
    replace_luminance,
    rgb_from_ycbcr,
    ycbcr_from_rgb,
)
from uw_recon_ros.preprocess.diffusion import diffuse
from uw_recon_ros.preprocess.extension import crop_extension, extend_symmetric
from uw_recon_ros.preprocess.filterbank import FARRAS, named_wavelet
from uw_recon_ros.preprocess.homomorphic import homomorphic_filter
from uw_recon_ros.preprocess.image_pairs import TwoThreads, checked_images, full_scale, unit_from_raw
from uw_recon_ros.preprocess.intensity import intensity_bounds, joint_percentiles, stretch
from uw_recon_ros.preprocess.matching_profile import channel_weights, denoise_evenly, excess_sigma, weighted_gray
from uw_recon_ros.preprocess.moire import remove_moire
from uw_recon_ros.preprocess.regions import Regions, find_regions
from uw_recon_ros.types import ByteImage, EnhancedPair, FloatImage, Mask, StereoPair
from uw_recon_ros.unseen_pixels import blackened, continued, mark_unseen

Views = tuple[FloatImage, FloatImage]


@dataclass(frozen=True)
class PreprocessParams(Params):
    """Parameters of `Preprocess`."""

    profile: str = param(
        "matching",
        "What the matcher sees: the paper's chain, a mild denoising, or the raw gray image.",
        choices=("paper", "matching", "none"),
    )
    appearance: str = param(
        "water",
        "What is shown and textured: colours balanced, light evened, noise kept low; or the paper's chain, as always "
        "under the profile 'paper'.",
        choices=("water", "paper"),
    )
    sensor_bits: int = param(
        0, "Bits a pixel of a 16-bit image really has; 0: the fewest of 8, 10, 12, 14, 16 that hold it.",
        unit="bit", low=0, high=16,
    )  # fmt: skip
    moire_removal: bool = param(True, "Step 1: remove single waves that run through the whole image.")
    moire_prominence: float = param(
        25.0, "How far a moire peak rises above the spectrum around it.", unit="dB", low=10.0, high=80.0
    )
    homomorphic_filtering: bool = param(True, "Step 4: even out the illumination and lift detail.")
    homomorphic_cutoff: float = param(
        16.0, "The paper's delta_w, per longer side of the image.", unit="cycles", low=0.1, high=1000.0
    )
    homomorphic_low_gain: float = param(0.5, "The paper's r_L: gain of the illumination.", low=0.0, high=1.0)
    homomorphic_high_gain: float = param(2.5, "The paper's r_H: gain of detail.", low=1.0, high=5.0)
    wavelet_denoising: bool = param(True, "Step 5: shrink wavelet coefficients that are noise.")
    wavelet: str = param(
        FARRAS, "Wavelet of step 5: farras, or an orthogonal or biorthogonal one of PyWavelets, e.g. bior4.4."
    )
    wavelet_levels: int = param(4, "Levels of the wavelet pyramid that are shrunk.", low=1, high=8)
    wavelet_strength: float = param(1.0, "Factor on the noise that step 5 estimates.", low=0.0, high=5.0)
    anisotropic_filtering: bool = param(True, "Step 6: smooth areas, keep edges.")
    diffusion_contrast: float = param(
        0.1, "The paper's K: differences well above it are edges; of the luminance range.", low=0.001, high=10.0
    )
    diffusion_rate: float = param(0.2, "The paper's lambda.", low=0.0, high=0.25)
    diffusion_iterations: int = param(4, "Times that step 6 is repeated.", low=0, high=100)
    intensity_clip: float = param(
        1.0, "Step 7: share of the pixels to saturate at either end.", unit="percent", low=0.0, high=20.0
    )
    chroma_follows: bool = param(
        True, "Step 8: scale the chrominance as the luminance was scaled; false: keep it, as the paper says."
    )
    color_equalization: bool = param(True, "Step 9: give red, green and blue one mean.")
    color_gain_limit: float = param(8.0, "Step 9: the most that a channel is brightened.", low=1.0, high=100.0)
    matching_strength: float = param(1.0, "Factor on the noise that the profile 'matching' removes.", low=0.0, high=5.0)

    def check_together(self) -> None:
        """Refuse a wavelet that nobody knows."""
        named_wavelet(self.wavelet)


@dataclass(frozen=True)
class Preprocess:
    """From a raw stereo pair to one to look at and one to match, both cameras by the same statistics.

    Parameters
    ----------
    params : PreprocessParams
    """

    params: PreprocessParams = field(default_factory=PreprocessParams)

    def __call__(self, pair: StereoPair, regions: Regions | None = None, *, shown: bool = True) -> EnhancedPair:
        """Enhance a pair; what it does not show takes no part, and is black in all four images.

        Parameters
        ----------
        pair : StereoPair
            uint8 or uint16, mono or RGB; both cameras of one shape and dtype.
        regions : Regions or None
            What either image does not show, as `RegionWatch` found it; None: found in this pair alone.
        shown : bool
            Whether there shall be a picture to look at; without one, what is to be matched stands in its place.

        Returns
        -------
        EnhancedPair
            Of the same size; what is to be matched does not depend on `shown`.

        Raises
        ------
        ImageError
            An image is empty, or the cameras differ in shape or dtype.
        TypeError
            Neither uint8 nor uint16.
        """
        raw = checked_images(pair)
        regions = regions or find_regions(pair)
        masks = regions.masks
        with TwoThreads() as both:
            scene = both(partial(unit_from_raw, full_scale=full_scale(raw, self.params.sensor_bits)), raw)
            unit = both(continued, scene, masks)
            clean = both(self._without_moire, unit)
            filtered = None
            if self.params.profile == "paper" or (shown and self.params.appearance == "paper"):
                filtered = self._filtered_luminance(both, both(luminance, clean), masks)
            to_match = both(_bytes, self._to_match(both, unit, clean, filtered))
            matching = both(mark_unseen, to_match, masks)
            pictures = matching
            if shown:
                pictures = both(blackened, both(_bytes, self._picture(both, clean, filtered, masks)), masks)
        return EnhancedPair(
            *pictures, *matching, pair.stamp_ns, pair.frame_id, pair.calibration, pair.findings + regions.findings
        )

    def _picture(self, both: TwoThreads, clean: Views, filtered: Views | None, masks: tuple[Mask, Mask]) -> Views:
        """What is shown: the paper's where there is a filtered luminance."""
        if filtered is None:
            return improve_appearance(both, clean, masks)
        return self._recolored(both, clean, filtered, masks)

    def _without_moire(self, image: FloatImage) -> FloatImage:
        """Step 1."""
        return remove_moire(image, prominence_db=self.params.moire_prominence) if self.params.moire_removal else image

    def _filtered_luminance(self, both: TwoThreads, views: Views, masks: tuple[Mask, Mask]) -> Views:
        """Steps 2 and 4 to 7, and the crop of step 8."""
        height, width = views[0].shape
        extended = both(extend_symmetric, views)
        even = both(partial(self._homomorphic, longer_side=max(height, width)), extended)
        smooth = both(self._diffused, self._in_unit_range(self._denoised(both, even), masks))
        cropped = both(partial(crop_extension, height=height, width=width), smooth)
        return both(partial(stretch, bounds=intensity_bounds(cropped, self.params.intensity_clip, masks)), cropped)

    def _homomorphic(self, extended: FloatImage, longer_side: int) -> FloatImage:
        """Step 4."""
        p = self.params
        if not p.homomorphic_filtering:
            return extended
        cutoff = p.homomorphic_cutoff * max(extended.shape) / longer_side
        return homomorphic_filter(extended, cutoff, p.homomorphic_low_gain, p.homomorphic_high_gain)

    def _denoised(self, both: TwoThreads, views: Views) -> Views:
        """Step 5, with one estimate of the noise for both cameras."""
        common = math.gcd(*views[0].shape)
        levels = min(self.params.wavelet_levels + 1, (common & -common).bit_length() - 1)  # halved so often, both sides
        if not self.params.wavelet_denoising or levels < 2:
            return views
        pyramids = both(partial(wavelet.decompose, levels=levels, wavelet=self.params.wavelet), views)
        sigma = self.params.wavelet_strength * wavelet.noise_sigma(pyramids)
        return both(wavelet.reconstruct, both(partial(wavelet.shrink, sigma=sigma), pyramids))

    def _in_unit_range(self, views: Views, masks: tuple[Mask, Mask]) -> Views:
        """Luminance as step 6 wants it: 1 where step 7 will saturate."""
        cropped = [crop_extension(view, *mask.shape) for view, mask in zip(views, masks, strict=True)]
        white = joint_percentiles(cropped, [100.0 - self.params.intensity_clip], masks)[0]
        factor = np.float32(1.0 / white if white > 0 else 1.0)
        return views[0] * factor, views[1] * factor

    def _diffused(self, extended: FloatImage) -> FloatImage:
        """Step 6."""
        p = self.params
        if not p.anisotropic_filtering:
            return extended
        return diffuse(
            extended, contrast=p.diffusion_contrast, rate=p.diffusion_rate, iterations=p.diffusion_iterations
        )

    def _recolored(self, both: TwoThreads, clean: Views, filtered: Views, masks: tuple[Mask, Mask]) -> Views:
        """Steps 3, 8 and 9; a mono image becomes gray RGB."""
        if clean[0].ndim == 2:
            return both(_gray_rgb, filtered)
        recolor = partial(_recolored, chroma_follows=self.params.chroma_follows)
        colored = both(recolor, clean, filtered)
        if not self.params.color_equalization:
            return colored
        gains = equalizing_gains(colored, max_gain=self.params.color_gain_limit, masks=masks)
        return both(partial(apply_gains, gains=gains), colored)

    def _to_match(self, both: TwoThreads, unit: Views, clean: Views, filtered: Views | None) -> Views:
        if self.params.profile == "paper":
            assert filtered is not None
            return filtered
        if self.params.profile == "none":
            return both(luminance, unit)
        gray = clean
        if clean[0].ndim == 3:
            gray = both(partial(weighted_gray, weights=channel_weights(clean)), clean)
        sigma = self.params.matching_strength * excess_sigma(gray)
        return both(partial(denoise_evenly, sigma=sigma), gray)


def _gray_rgb(luminance: FloatImage) -> FloatImage:
    return np.repeat(luminance[..., None], 3, axis=2)


def _recolored(rgb: FloatImage, filtered: FloatImage, chroma_follows: bool) -> FloatImage:
    return rgb_from_ycbcr(replace_luminance(ycbcr_from_rgb(rgb), filtered, chroma_follows=chroma_follows))


def _bytes(image: FloatImage) -> ByteImage:
    rounded: ByteImage = (np.clip(image, 0, 1) * np.float32(255) + np.float32(0.5)).astype(np.uint8)
    return rounded
