"""Clips of robot logs: the images, camera and poses of ROS 1 bags, ROS 2 bags and MCAP files."""

import functools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geovp_classic.data.findings import Findings
from geovp_classic.data.formats import bags
from geovp_classic.data.formats.bags import Bag, BagImages
from geovp_classic.data.formats.frame_tree import FrameTree
from geovp_classic.data.frames.image_frames import FrameFiles
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.data.recordings.scans import Scan, sequence_folders
from geovp_classic.data.recordings.sequences import PosedSequences
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class RosBag(PosedSequences):
    """Bags of a folder, or one bag; settings as `PosedSequences`'.

    `image_topic` and `pose_topic` name topics of which the bag has several. The camera is that of
    its CameraInfo, or `intrinsics`, (fx, fy, cx, cy) in pixels of the stored images.

    Poses are those of tf; if it does not move the camera, or `pose_topic` is given, those of a
    topic of type Odometry, PoseStamped, PoseWithCovarianceStamped or TransformStamped. "" stands
    for no poses. They become the camera's by tf. `body_frame` is the frame that they are of, else
    the one that their messages name, else the camera's. They are interpolated between neighbours
    at most `max_gap_s` apart. Times are those of the stamps, in seconds since 1970.
    """

    name = "rosbag"

    image_topic: str | None = None
    pose_topic: str | None = None
    body_frame: str | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    max_gap_s: float = 0.25  # odometry comes at 10 to 50 Hz, and may lack a message

    def folders(self) -> dict[str, Path]:
        """Return the bags by name; BadData if there are none."""
        expected = "a .bag, .mcap or .db3 file, or a folder with metadata.yaml"
        return sequence_folders(self.root, bags.is_bag, expected)

    def scans(self, folder: Path, findings: Findings) -> dict[str, Scan]:
        """Scan a bag with each of its image topics."""
        topics: list[str] = []
        with findings.catch(folder):
            topics = Bag(folder).topics("image")
        return {topic: self.scan(folder, findings, topic) for topic in topics or [""]}

    def scan(self, folder: Path, findings: Findings, image_topic: str = "") -> Scan:
        """Scan a bag with one of its image topics, by default that of the settings."""
        scan = Scan((), np.empty(0))
        with findings.catch(folder):
            bag = Bag(folder)
            images = BagImages(bag, image_topic or self.image_topic, self.image_bits)
            # clips overlap
            load = functools.lru_cache(maxsize=2 * self.num_frames)(images.read)
            sizes_px = (images.size_px,) * len(images.names)
            reader = FrameFiles(images.names, sizes_px, load)
            scan = Scan(images.names, images.times_s, reader=reader)
            camera = bag.camera(images.topic, images.size_px)
            if self.intrinsics is not None:
                view = Intrinsics(*self.intrinsics, *images.size_px)
                camera = DistortedCamera(view)
            if camera is not None:
                cameras = (camera,) * len(images.names)
                scan = replace(scan, cameras=cameras)
            scan = replace(scan, world_from_cam=self._poses(bag, images))
        return scan

    def _poses(self, bag: Bag, images: BagImages) -> FloatArray | None:
        """Return world_from_cam [N, 4, 4]; None if nothing moves the camera."""
        if self.pose_topic == "":
            return None
        tree = FrameTree()
        for topic in bag.topics("tf"):
            bag.add_links(tree, topic)
        links = tree.path(images.frame_id)
        if self.pose_topic or all(link.is_fixed for link in links):
            pose_topic = bag.choose("pose", self.pose_topic)
            motion = FrameTree()
            bag.add_links(motion, pose_topic)
            for child, link in motion.items():
                body = self.body_frame or child or images.frame_id
                tree[body] = link
                links = tree.path(images.frame_id)
                if link not in links:
                    raise BadData(
                        f"{bag.path}: {pose_topic} has the poses of {body!r}, which tf does not "
                        f"connect to the camera, {images.frame_id!r}: record /tf_static, or give "
                        f'body_frame = "{images.frame_id}" if they are the camera\'s, or '
                        'pose_topic = ""'
                    )
                links = links[: links.index(link) + 1]
        if all(link.is_fixed for link in links):
            return None
        world_from_cam = np.eye(4)
        for link in links:
            world_from_cam = link.at(images.times_s, self.max_gap_s) @ world_from_cam
        return world_from_cam
