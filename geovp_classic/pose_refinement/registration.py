"""Registration of given poses to the images: bundle adjustment of tracked corners, in the unit of
the given poses.

Recorded poses can be wrong by more than a pixel from one frame to the next (GPS and gyroscopes are
smooth over hundreds of metres, not over ten), and a plane sweep needs a quarter of one. Corners of
a reference image are tracked through the others (Lucas & Kanade 1981, with a forward-backward
check), and their inverse depths are adjusted together with the poses (Triggs 2000). The given poses
are the prior, which also fixes the scale.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.bundle_adjustment import AnchoredAdjustment
from geovp_classic.geometry.optical_flow import track_points
from geovp_classic.observation import ImageStream, observations_of, stream_needs
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    PrivilegedInput,
)


@dataclass(frozen=True)
class ReferenceTracker:
    """Corners of the middle of a reference image, tracked from frame to frame until lost."""

    # In a square image; proportionally more in wider ones. Set by hand: 65 for each of the six
    # parameters of a pose.
    max_corners: int = 400
    # Width over height of the middle. Corners farther out make the fit within the square worse.
    # Chosen on val: 1.6 instead of 1.25 brings .03 dB and -.0015 LPIPS.
    max_aspect: float = 1.6
    quality: float = 0.01  # of the best corner, as in OpenCV's examples
    # Least distance of corners, over the image's height: 400 of them fill a square of 40 x 40 cells
    # to a quarter.
    spacing_fraction: float = 0.025
    # In images of up to `tall_px` rows; proportionally more in taller ones. Set by hand, between
    # OpenCV's default of 21 and the size of a corner.
    window_px: int = 15
    tall_px: int = 256  # height of the crops for which settings were chosen
    max_return_px: float = 0.5  # forward-backward error: tracks are to be exact to a fraction of it
    # Levels of the pyramid above the image, four halvings find 7 px as 112 px.
    num_levels: int = 4
    # With the motion of the frame before as the prediction, half of that.
    num_predicted_levels: int = 2

    def track(
        self,
        images: ByteArray,  # [P, H, W] grey
        reference: int,
        mask: BoolArray,  # [H, W], pixels without corners
    ) -> tuple[FloatArray, BoolArray]:
        """Return pixels [P, N, 2] of corners in all images, and where they are visible [P, N]."""
        # Corners of the reference, in both directions of time.
        start = self._corners(images[reference], mask)
        pixels = np.tile(start, (len(images), 1, 1))
        is_visible = np.zeros(pixels.shape[:2], bool)
        is_visible[reference] = True
        height = images.shape[1]
        window_px = int(self.window_px * max(1, height / self.tall_px)) | 1  # odd
        backward = range(reference - 1, -1, -1)
        forward = range(reference + 1, len(images))
        for steps in (backward, forward):
            before = reference
            motion = np.zeros_like(start)
            num_levels = self.num_levels
            for step in steps:
                # Corners that are lost once stay lost: another one may be found in their place.
                is_followed = is_visible[before]
                pixels[step] = pixels[before]
                if is_followed.any():
                    places = pixels[before, is_followed]
                    tracked, is_tracked, _ = track_points(
                        (images[before], images[step]),
                        places,
                        places + motion[is_followed],
                        window_px,
                        num_levels,
                        max_return_px=self.max_return_px,
                    )
                    pixels[step, is_followed] = tracked
                    is_visible[step, is_followed] = is_tracked
                motion = pixels[step] - pixels[before]
                num_levels = self.num_predicted_levels  # the last motion is a good prediction
                before = step
        return pixels.astype(np.float64), is_visible

    def _corners(self, image: ByteArray, mask: BoolArray) -> FloatArray:
        """Return corners [N, 2] of the middle of an image, the strongest first."""
        height, width = image.shape
        aspect = float(np.clip(width / height, 1, self.max_aspect))
        margin = max(0, round((width - self.max_aspect * height) / 2))
        middle = np.zeros((height, width), np.uint8)
        middle[:, margin : width - margin] = 255
        kernel = np.ones((self.window_px, self.window_px))
        middle[cv2.dilate(mask.astype(np.uint8), kernel) > 0] = 0
        max_corners = int(self.max_corners * aspect)
        spacing_px = self.spacing_fraction * height
        corners = cv2.goodFeaturesToTrack(image, max_corners, self.quality, spacing_px, mask=middle)
        if corners is None:
            return np.zeros((0, 2), np.float32)
        return corners.reshape(-1, 2)


@dataclass(frozen=True)
class ImageRegistration:
    """Adjustment of given poses to tracked corners of a reference image."""

    tracker: ReferenceTracker = ReferenceTracker()
    adjustment: AnchoredAdjustment = AnchoredAdjustment()
    # Visible in at least one other frame; with fewer the given poses stay. Five for each of the six
    # parameters of a pose.
    min_corners: int = 30
    # Largest depth of a corner, over the largest distance from the reference: a tenth of a pixel of
    # parallax at a focal length of 1000 px.
    max_depth: float = 1e4

    def register(
        self,
        images: ByteArray,  # [P, H, W] grey
        camera: Intrinsics,
        world_from_cam: FloatArray,  # [P, 4, 4]
        reference: int,
        mask: BoolArray,  # [H, W], pixels that do not show the scene
    ) -> FloatArray:
        """Return the adjusted poses [P, 4, 4]; that of the reference stays.

        All poses stay without motion or enough corners.
        """
        # The adjustment expects the reference first; without motion there is no depth.
        others = np.delete(np.arange(len(images)), reference)
        order = np.array([reference, *others])
        world_from_reference = world_from_cam[reference]
        given = se3.inverse(world_from_cam[order]) @ world_from_reference
        if not given[1:, :3, 3].any():
            return world_from_cam
        # Tracks of corners; those that no other frame shows say nothing.
        pixels, is_visible = self.tracker.track(images, reference, mask)
        is_used = is_visible[others].any(axis=0)
        if is_used.sum() < self.min_corners:
            return world_from_cam
        pixels = np.where(is_visible[..., None], pixels, np.nan)
        observed = pixels[order][:, is_used]
        # Points by triangulation with the given poses, then both together.
        points = self._points(observed, given, camera)
        adjusted = self.adjustment.adjust(given, points, observed, camera)
        registered = world_from_cam.copy()
        registered[others] = world_from_reference @ se3.inverse(adjusted[1:])
        return registered

    def _points(
        self,
        pixels: FloatArray,  # [K, N, 2]; NaN where not observed
        cam_from_first: FloatArray,  # [K, 4, 4]
        camera: Intrinsics,
    ) -> FloatArray:
        """Return points [N, 3] on the rays of the first camera that fit the other pixels.

        The inverse depth q solves (u, v) (a_z + q b_z) = (a + q b)_xy.
        """
        rays = pinhole.unproject(pixels[0], 1.0, camera)
        matrix = camera.matrix
        rotations = np.swapaxes(matrix @ cam_from_first[1:, :3, :3], -1, -2)
        # Each pixel (u, v) of another frame gives two equations, linear in q. They are solved by
        # least squares over all frames that show the corner.
        a = rays @ rotations  # [K - 1, N, 3]
        b = (cam_from_first[1:, :3, 3] @ matrix.T)[:, None]  # [K - 1, 1, 3]
        factor = pixels[1:] * b[..., 2:] - b[..., :2]
        target = a[..., :2] - pixels[1:] * a[..., 2:]
        numerator = np.nansum(factor * target, axis=(0, 2))
        denominator = np.nansum(factor**2, axis=(0, 2))
        distance = np.linalg.norm(cam_from_first[:, :3, 3], axis=1).max()
        # The sky, and corners whose motion contradicts their depth, are far away.
        min_inverse_depth = 1 / (self.max_depth * distance)
        inverse_depths = numerator / np.maximum(denominator, 1e-12)
        return rays / np.maximum(inverse_depths, min_inverse_depth)[:, None]


@dataclass(frozen=True)
class Registration:
    """Past poses adjusted to tracked corners; future ones are rotated as the past directions of
    motion were.

    The last observed pose is the reference and stays. Poses before the last `num_frames` move with
    the first of those.
    """

    frames: ImageStream = "crop"
    num_frames: int = 10  # one second at KITTI's 10 Hz, as many as depth fusion uses
    registration: ImageRegistration = ImageRegistration()
    # Part of the past error of the direction of motion that is expected in the future. By hand.
    persistence: float = 0.8
    # Of the longest distance; shorter ones have no reliable direction. Set by hand.
    min_fraction: float = 0.2

    def __post_init__(self) -> None:
        if self.num_frames < 2:
            raise BadData(f"registration: num_frames is {self.num_frames}, expected 2 or more")

    @property
    def needs(self) -> PrivilegedInput:
        """Return the uncropped frames if they are used, else nothing."""
        return stream_needs(self.frames)

    def refine(self, context: Context, motion: Motion) -> Motion:
        """Return the motion with registered past poses, its futures turned about the last one."""
        observed = observations_of(context, self.frames)
        steps = np.flatnonzero(observed.is_usable)[-self.num_frames :]
        given = motion.past.world_from_cam
        adjusted = self.registration.register(
            observed.greys[steps],
            observed.intrinsics,
            given[steps],
            reference=len(steps) - 1,
            mask=observed.mask,
        )
        # Earlier poses keep their place relative to the first adjusted one.
        first = steps[0]
        past = given.copy()
        past[:first] = adjusted[0] @ se3.inverse(given[first]) @ given[:first]
        past[steps] = adjusted
        # The future turns about the last usable pose, as the past directions turned.
        world_from_last = given[steps[-1]]
        last_from_world = se3.inverse(world_from_last)
        correction = direction_correction(
            last_from_world @ given[steps[:-1]],
            last_from_world @ adjusted[:-1],
            self.persistence,
            self.min_fraction,
        )
        last_from_cam = last_from_world @ motion.futures
        last_from_cam[..., :3, 3] @= correction.T
        return replace(
            motion,
            past=replace(motion.past, world_from_cam=past),
            futures=world_from_last @ last_from_cam,
        )


def direction_correction(
    given: FloatArray,  # [S, 4, 4], reference from source
    adjusted: FloatArray,  # [S, 4, 4]
    persistence: float,
    min_fraction: float,  # of the longest distance, of reliable directions
) -> FloatArray:
    """Return `persistence` times the rotation [3, 3] from given to adjusted directions of motion.

    A wrong mounting angle of the recorded camera, or a drifting height, rotates all directions
    alike, future ones too.
    """
    before = given[:, :3, 3]
    after = adjusted[:, :3, 3]
    distance = np.linalg.norm(before, axis=1)
    is_reliable = distance > min_fraction * distance.max(initial=0)
    is_reliable &= after.any(axis=1)
    if not is_reliable.any():
        return np.eye(3)
    # The cross product of two directions is the axis times the sine of the angle between them.
    lengths = distance * np.linalg.norm(after, axis=1)
    turns = np.cross(before[is_reliable], after[is_reliable]) / lengths[is_reliable, None]
    twist = np.concatenate([np.zeros(3), persistence * turns.mean(axis=0)])
    return se3.exp(twist)[:3, :3]
