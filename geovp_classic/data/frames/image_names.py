"""Names of images: which files of a folder are frames of one camera, and in which order.

An order that can be read in two ways is refused.
"""

import fnmatch
import itertools
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from geovp_classic import files
from geovp_classic.data.findings import Findings
from geovp_classic.errors import BadData
from geovp_classic.types import IntArray


def is_image(path: Path) -> bool:
    """Return whether a file has the name of a visible image."""
    return bool(
        re.fullmatch(
            r"[^.].*\.(png|jpe?g|webp|bmp|tiff?|p[gp]m|jp2)",
            path.name,
            re.IGNORECASE,
        )
    )


def images_below(root: Path) -> Iterator[Path]:
    """Yield the images below a folder and below linked folders, but none of them twice."""
    seen = set()
    for folder, folders, names in os.walk(root, followlinks=True):
        real = os.path.realpath(folder)
        if real in seen:  # links in a circle
            folders.clear()
            continue
        seen.add(real)
        yield from filter(is_image, (Path(folder, name) for name in names))


def image_files(folder: Path) -> list[Path]:
    """Return the images of a folder by name, numbers in names counted as numbers (2 before 10)."""
    what = f"{folder} cannot be listed"
    with files.checked(what, "give a video or a folder of images"):
        return sorted(filter(is_image, folder.iterdir()), key=natural_order)


def image_series(folder: Path, name_pattern: str | None = None) -> list[Path]:
    """Return the images of a folder in their order, of which the names must leave no doubt.

    `name_pattern` chooses some: "frame*.png" those whose names differ by numbers alone, or else all
    that it matches. BadData names the series of images that lie between each other, such as frames
    and masks, and numbers that can be read in two ways.
    """
    paths = image_files(folder)
    if name_pattern is not None:
        paths = _matching(paths, name_pattern)
        if not paths:
            raise BadData(
                f"{folder} holds no image called {name_pattern}: give another name_pattern"
            )
    series = Counter(series_name(path.name) for path in paths)
    if name_pattern is None and sum("*" in name for name in series) > 3 + len(paths) / 2:
        raise BadData(
            f"{folder} holds {paths[0].name} to {paths[-1].name}, whose names have no common form: "
            'number the images, or give name_pattern = "*" for this order'
        )
    if equal := _equal_numbers(paths):
        names = ", ".join(f"{name} ({count} images)" for name, count in series.items())
        (main_series, _), *others = series.most_common()
        choice = f', or give name_pattern = "{main_series}"' if others else ""
        raise BadData(
            f"{folder} holds {len(series)} series of images, {names:.300}, of which "
            f"{equal[0].name} and {equal[1].name} have the same number: remove one of them{choice}"
        )
    # "1.5" and "1.25" have another order as decimal numbers than by their parts.
    is_decimal = all(re.fullmatch(r"\d+\.\d+(e[-+]\d+)?", path.stem) for path in paths)
    if is_decimal and sorted(paths, key=lambda path: float(path.stem)) != paths:
        raise BadData(
            f"{folder} holds {paths[0].name} to {paths[-1].name}, whose order is another if they "
            "are decimal numbers: write equally many digits behind the point"
        )
    patterns = _camera_patterns(paths)
    if name_pattern is None and not is_decimal and patterns:
        raise BadData(
            f"{folder} holds {paths[0].name} to {paths[-1].name}, as of several cameras: give "
            f'name_pattern = "{patterns[0]}" or "{patterns[1]}", or "*" for all images in this '
            "order"
        )
    if name_pattern is None and _began_again(paths):
        raise BadData(
            f"{folder} holds {paths[0].name} to {paths[-1].name}, as if a counter began again: "
            'number the images in their order, or give name_pattern = "*" for this order'
        )
    return paths


def _began_again(paths: list[Path]) -> bool:
    """Return whether a camera's counter seems to have gone from 9999 to 1.

    Its numbers have a wide gap inside, but none from the last one to the first.
    """
    numbers = [int(each) for path in paths for each in re.findall(r"^\D*(\d+)\D*$", path.stem)]
    if len(numbers) < 2:
        return False
    gaps = [after - before for before, after in itertools.pairwise(numbers)]
    end_gap = numbers[0] + 10 ** len(str(numbers[-1])) - numbers[-1]
    return max(gaps) > max(100, 10 * end_gap, 10 * min(gaps))


def _matching(paths: list[Path], name_pattern: str) -> list[Path]:
    """Return the images of the series that a pattern is the name of, or else all that match it.

    "frame*.png" matches frame1_mask.png, too, but is the name of another series.
    """
    series = [path for path in paths if series_name(path.name) == name_pattern]
    return series or [path for path in paths if fnmatch.fnmatchcase(path.name, name_pattern)]


def _equal_numbers(paths: list[Path]) -> list[Path]:
    """Return images whose numbers are equal, the last one aside, or none.

    They are of several series, or an image is there twice, as "frame 1.png" and "frame 1 (2).png".
    """
    by_number: dict[tuple[int, ...], list[Path]] = {}
    for path in paths:
        numbers = tuple(map(int, re.findall(r"\d+", path.stem)))
        by_number.setdefault(numbers or (-len(by_number),), []).append(path)
    groups = ([*by_number.get(numbers[:-1], ()), *by_number[numbers]] for numbers in by_number)
    return next((group for group in groups if len(group) > 1), [])


def series_name(name: str) -> str:
    """Return a name with a star for each number, which the names of a series share."""
    return re.sub(r"\d+", "*", name)


def _camera_patterns(paths: list[Path], max_cameras: int = 8) -> list[str]:
    """Return a pattern for the images of each camera if names number several cameras.

    Either "cam" stands before the number, as in cam0_0001 (but not before a date, as in
    dashcam_20261129_0001), or names end in it, and the cameras have the same frames: 0001_0,
    0001_1, 0002_0 and so on.
    """
    after_word = r"(?i)^(.*?cam(?:era)?[-_ ]?)(\d\d?)(?!\d)(.*)$"
    at_end = r"^(.*\d\D+)(\d+)(\D*\.\w+)$"
    for expression in (after_word, at_end):
        names = [name for path in paths for name in re.findall(expression, path.name)]
        images = Counter(series_name(a) + camera + series_name(b) for a, camera, b in names)
        frames = {(a, b) for a, _, b in names}
        if len(names) < len(paths) or not 1 < len(images) <= max_cameras:
            continue
        if expression == after_word and min(images.values()) > 1:
            return list(images)
        cameras = sorted({int(camera) for _, camera, _ in names})
        is_consecutive = cameras == list(range(cameras[0], cameras[0] + len(images)))
        is_complete = len(images) * len(frames) == len(paths)
        if is_consecutive and is_complete and len(images) < len(frames):
            return list(images)
    return []


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts file names with numbers in them counted as numbers."""
    pieces = re.findall(r"\d+|\D", path.name)
    return [(int(piece), "") if piece.isdecimal() else (-1, piece) for piece in pieces]


def frame_numbers(paths: Sequence[Path]) -> IntArray:
    """Return the numbers [N] of frames at a constant rate, some of which may be missing.

    Each name must hold one number, but none of a clock; if the steps between them are not multiples
    of the usual step, none is missing.
    """
    names = [re.findall(r"^\D*(\d{1,9})\D*$", path.stem) for path in paths]
    if len(names) > 1 and all(names):
        numbers = np.array(names, int)[:, 0]
        steps = np.diff(numbers)
        usual = int(np.median(steps))
        if steps.min() > 0 and not (steps % usual).any():
            return (numbers - numbers[0]) // usual
    return np.arange(len(paths))


def numbered_images(folder: Path, findings: Findings) -> tuple[Path, ...]:
    """Return the images 000000, 000001, ... of a folder; report gaps, duplicates, other files."""
    images: dict[int, Path] = {}
    for path in sorted(folder.glob("[!.]*")):
        if not is_image(path) or not path.stem.isdecimal():
            findings.add(path, "is not a numbered image: ignored", severity="note")
            continue
        first = images.setdefault(int(path.stem), path)
        if first != path:
            findings.add(path, f"has the same number as {first.name}: keep one of them")
    missing = set(range(len(images))) - images.keys()
    if not images:
        findings.add(
            folder,
            "holds no images, expected 000000.png (or jpg, webp, ...) and so on",
        )
    if missing:
        findings.add(
            folder,
            f"lacks frame {min(missing):06d}: number frames without a gap",
        )
    return tuple(images[number] for number in sorted(images))
