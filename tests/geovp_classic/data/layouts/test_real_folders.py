"""Folders as people have them: turned photos, linked folders, several models, other clocks."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from geovp_classic.data.doctor import Doctor
from geovp_classic.data.layouts.colmap import Colmap
from geovp_classic.data.layouts.folder import Folder
from geovp_classic.types import Clip

Write = Callable[..., Path]
ORIENTATION = 0x112


def turned_photo(path: Path, orientation: int) -> None:
    """Write 60x40 pixels with a white stripe along the upper stored border, and a tag."""
    stored = np.zeros((40, 60, 3), np.uint8)
    stored[:10] = 255
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    Image.fromarray(stored).save(path, exif=exif, quality=95)


def test_photos_without_a_calibration_are_upright(tmp_path: Path) -> None:
    """The stripe along the upper stored border is at the right, of images that are alike."""
    for number, orientation in enumerate((6, 6, 1)):
        turned_photo(tmp_path / f"{number}.jpg", orientation)
    examination = Doctor().examine(tmp_path)
    assert "2.jpg: is 60x40 pixels, but those before are 40x60" in str(examination.findings[0])
    data = Folder(tmp_path, (50, 50, 20, 20), num_frames=2, with_full=True, size_px=(20, 20))
    image = data[0].full.frames[0]
    assert image.shape == (60, 40, 3)
    assert image[:, -1].mean() > 200 > 50 > image[:, 0].mean()


@pytest.mark.parametrize("orientation", [3, 6])
def test_calibrated_photos_show_the_stored_pixels(
    orientation: int, tmp_path: Path, write_colmap: Write, street: Clip
) -> None:
    folder = write_colmap(tmp_path, "street", street)
    expected = Colmap(folder, num_frames=5, size_px=(64, 64))[0].frames
    for path in (folder / "images").iterdir():
        exif = Image.Exif()
        exif[ORIENTATION] = orientation
        Image.open(path).save(path, exif=exif)
    np.testing.assert_array_equal(
        Colmap(folder, num_frames=5, size_px=(64, 64))[0].frames, expected
    )
    assert Doctor().examine(folder).is_sound


def test_linked_folders_are_followed_once(
    tmp_path: Path, write_colmap: Write, street: Clip
) -> None:
    """The link back to the folder itself would never end."""
    folder = write_colmap(tmp_path, "street", street)
    (folder / "images").rename(tmp_path / "elsewhere")
    (folder / "images").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere" / "loop").symlink_to(tmp_path / "elsewhere")
    examination = Doctor().examine(folder)
    assert examination.is_sound
    assert [row["frames"] for row in examination.rows] == ["12"]


def test_the_largest_model_is_used(tmp_path: Path, write_colmap: Write, street: Clip) -> None:
    """The first has 3 of 12 images, as after a mapper that began anew."""
    import pycolmap

    folder = write_colmap(tmp_path, "street", street)
    (folder / "sparse" / "0").rename(folder / "sparse" / "1")
    model: Any = pycolmap.Reconstruction(str(folder / "sparse" / "1"))
    for number in sorted(model.reg_image_ids())[3:]:
        model.deregister_frame(model.images[number].frame_id)
    (folder / "sparse" / "0").mkdir()
    model.write_binary(str(folder / "sparse" / "0"))
    examination = Doctor().examine(folder)
    assert [row["poses"] for row in examination.rows] == ["12"]
    assert "2 models: the largest, of 12 images" in str(examination.findings[0])
    nerfstudio = tmp_path / "nerfstudio"
    (nerfstudio / "colmap").mkdir(parents=True)
    (folder / "sparse").rename(nerfstudio / "colmap" / "sparse")
    (folder / "images").rename(nerfstudio / "images")
    assert len(Colmap(nerfstudio, num_frames=12, size_px=(64, 64))) == 1
