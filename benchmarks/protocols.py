"""Protocols of papers by name: which frames are seen and predicted, how they are scored, what a table's numbers mean.

A matrix file follows one with `[protocol] name = "fvs20"`; what is given beside the name replaces the protocol's own
choice, so that another data set can be measured in its form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.registry import nearest

Spec = Mapping[str, Any]
DATE = "2011_09_26_drive_"


@dataclass(frozen=True)
class Protocol:
    """The choices of a paper, and of the code that its numbers come from."""

    name: str
    paper: str
    data: str  # in words
    num_past: int
    num_future: int
    size_px: tuple[int, int]  # (width, height)
    stride: int  # frames between the starts of two clips
    metrics: Mapping[str, Spec]  # by column
    dataset: Spec | None = None  # without its root; None where no reader of ours reads it
    num_clips: int | None = None
    num_samples: int = 1  # the best one counts, chosen per clip and metric by its mean over steps
    horizons: tuple[int, ...] = ()  # "t+k" in tables is the mean over the first k frames; with none, over all frames
    differences: str = ""  # what cannot be done here as it is done there

    @property
    def about(self) -> str:
        """All of it in a few lines."""
        clips = f"{self.num_clips:,} clips" if self.num_clips else "number of clips not given"
        values = "; ".join(f"t+{k} is the mean over the first {k}" for k in self.horizons)
        best = f"best of {self.num_samples} per clip and metric" if self.num_samples > 1 else ""
        lines = [
            f"{self.name}: {self.paper}",
            f"{self.data}; {self.size_px[0]}x{self.size_px[1]}, {self.num_past} seen, the next {self.num_future} "
            f"predicted; {clips}, stride {self.stride}",
            f"metrics: {', '.join(_words(column, spec) for column, spec in self.metrics.items())}",
            "; ".join(filter(None, (best, values or "means over all predicted frames"))),
            f"differs here: {self.differences}" if self.differences else "",
        ]
        return "\n  ".join(filter(None, lines))


def _words(column: str, spec: Spec) -> str:
    settings = ", ".join(f"{key} {value}" for key, value in spec.items() if key != "name")
    return f"{column} ({settings})" if settings else column


JOINT_PSNR, PSNR_PER_CHANNEL = {"name": "psnr"}, {"name": "psnr", "channels": "each"}
SSIM, OLD_SCIKIT_SSIM = {"name": "ssim"}, {"name": "ssim", "window": "uniform", "data_range": 2.0}
LPIPS, LPIPS_BGR = {"name": "lpips"}, {"name": "lpips", "channels": "bgr"}
SLAMP_TEST = tuple(f"{DATE}{n:04d}" for n in (2, 9, 13, 20, 23, 27, 29, 36, 46, 48, 52, 56, 59, 64, 84, 86, 93, 96))
SLAMP_TEST += tuple(f"{DATE}{number:04d}" for number in (101, 106, 117))
SLAMP_TEST += ("2011_09_28_drive_0002", "2011_09_29_drive_0071", "2011_09_30_drive_0016", "2011_09_30_drive_0018")
SLAMP_TEST += ("2011_09_30_drive_0027", "2011_10_03_drive_0027", "2011_10_03_drive_0047")
FIRST_ONLY = 10**6  # a stride beyond every drive: one clip each
BYTES = "predictions are scored in 8 bits, there as fractions"

_ALL = (
    Protocol(
        "thesis",
        "Geometry-Based Video Prediction with Camera Motion for Mobile Robotics, table 4.1",
        "KITTI odometry, two test sequences that are not named; the split `test` is ours",
        num_past=10,
        num_future=20,
        size_px=(256, 256),
        stride=10,
        metrics={"psnr": JOINT_PSNR, "ssim": SSIM, "lpips": LPIPS},
        dataset={"name": "kitti", "split": "test"},
        num_samples=100,
        differences="the thesis does not say which definition of each metric it uses; these are this suite's",
    ),
    Protocol(
        "svg18",
        "Denton & Fergus 2018, Stochastic video generation with a learned prior (their code's evaluation)",
        "BAIR robot pushing, 256 test videos",
        num_past=2,
        num_future=28,
        size_px=(64, 64),
        stride=30,
        metrics={"ssim": OLD_SCIKIT_SSIM, "psnr": PSNR_PER_CHANNEL},
        num_clips=256,
        num_samples=100,
        differences=BYTES,
    ),
    Protocol(
        "srvp20",
        "Franceschi et al. 2020, Stochastic latent residual video prediction; on KITTI: Akan et al. 2021, SLAMP",
        "KITTI raw, SLAMP's 28 test drives, the first window of each",
        num_past=10,
        num_future=20,
        size_px=(310, 92),
        stride=FIRST_ONLY,
        metrics={"psnr": PSNR_PER_CHANNEL, "ssim": SSIM, "lpips": LPIPS},
        dataset={"name": "kitti-raw", "sequences": list(SLAMP_TEST), "camera": 2, "fit": "stretch"},
        num_clips=28,
        num_samples=100,
        differences=f"SLAMP adds camera 3, skips drives' standing parts and resizes with Pillow; {BYTES}",
    ),
    Protocol(
        "synsin20",
        "Wiles et al. 2020, SynSin: view synthesis, not prediction (their code's evaluation on KITTI)",
        "KITTI odometry 00 to 10, 464 given pairs at most 5 frames apart, true poses",
        num_past=1,
        num_future=5,
        size_px=(256, 256),
        stride=5,
        metrics={"psnr": JOINT_PSNR, "ssim": {"name": "ssim", "border": "zero"}},
        dataset={"name": "kitti", "sequences": [f"{number:02d}" for number in range(11)], "camera": 2},
        differences="all windows in place of the listed pairs, the resized centre square in place of their 256x256 "
        "images; their 'perceptual similarity' (VGG16 features, unweighted cosines) is not here, nor is it LPIPS",
    ),
    Protocol(
        "openstl",
        "Tan et al. 2023, OpenSTL, KittiCaltech (their code's evaluation)",
        "Caltech Pedestrian at 10 Hz, after training on KITTI",
        num_past=10,
        num_future=1,
        size_px=(160, 128),
        stride=11,
        metrics={"psnr": JOINT_PSNR, "ssim": OLD_SCIKIT_SSIM, "lpips": LPIPS, "lpips-bgr": LPIPS_BGR},
        differences=f"their loader of the videos leaves channels as OpenCV reads them, BGR; {BYTES}",
    ),
    Protocol(
        "fvs20",
        "Wu et al. 2020, Future video synthesis with object motion prediction; also OPT, DMVFN, Motion Graph",
        "KITTI raw, image_02 of drives 2011_09_26 0060, 0084, 0093, 0096 (78, 383, 433 and 475 frames)",
        num_past=4,
        num_future=5,
        size_px=(832, 256),
        stride=1,
        metrics={"ms-ssim": {"name": "ms-ssim"}, "lpips": LPIPS, "lpips-bgr": LPIPS_BGR},
        dataset={
            "name": "kitti-raw",
            "sequences": [f"{DATE}0060", f"{DATE}0084", f"{DATE}0093", f"{DATE}0096"],
            "camera": 2,
            "fit": "stretch",
        },
        num_clips=1337,
        horizons=(1, 3, 5),
        differences=f"FVS and OPT give LPIPS RGB in [0, 1], DMVFN BGR in [-1, 1]: both orders are scored; {BYTES}",
    ),
)
ALL: Mapping[str, Protocol] = {protocol.name: protocol for protocol in _ALL}


def load(name: str) -> Protocol:
    """The protocol of a name; UnknownComponent with the nearest one."""
    if name not in ALL:
        raise UnknownComponent(f"there is no protocol {name!r}{nearest(name, tuple(ALL))}")
    return ALL[name]


def matrix_protocol(name: str, root: Path | str | None = None, dataset: Spec | None = None) -> dict[str, Any]:
    """The tables `protocol` and `metrics` of a matrix; `dataset` replaces the protocol's own, in its form.

    BadData for a protocol whose data nothing here reads, unless another data set is given.
    """
    protocol = load(name)
    chosen = dataset if dataset is not None else protocol.dataset
    if chosen is None:
        raise BadData(f"{name} is measured on {protocol.data}, which nothing here reads: give dataset = {{ ... }}")
    where = {} if root is None else {"root": str(root)}
    form = {"num_past": protocol.num_past, "num_future": protocol.num_future, "stride": protocol.stride}
    table = {"dataset": {**chosen, **where}, **form, "size_px": list(protocol.size_px)}
    return {"protocol": table, "metrics": {"frame": dict(protocol.metrics)}}


def expanded(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """A matrix file's content with its protocol's name spelled out; as it is where there is no name."""
    given = content.get("protocol")
    if not isinstance(given, Mapping) or not isinstance(given.get("name"), str):
        return content
    tables = matrix_protocol(given["name"], given.get("root"), given.get("dataset"))
    own = {key: value for key, value in given.items() if key not in ("name", "root", "dataset")}
    metrics = {**tables["metrics"], **content.get("metrics", {})}
    return {**content, "protocol": {**tables["protocol"], **own}, "metrics": metrics}
