"""Images and videos are read as they are; incomplete files are refused."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image, ImageOps

from geovp_classic.data.frames.image_frames import FrameFiles, image_size, read_depth, read_image
from geovp_classic.errors import BadData

ENCODINGS = {
    "a.png": [],
    "a.jpg": [cv2.IMWRITE_JPEG_QUALITY, 95],
    "progressive.jpg": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
    "lossy.webp": [cv2.IMWRITE_WEBP_QUALITY, 90],
    "lossless.webp": [cv2.IMWRITE_WEBP_QUALITY, 101],
    "a.bmp": [],
    "a.tif": [],
    "a.ppm": [],
    "a.jp2": [],
}


def scene() -> np.ndarray:
    """Return a smooth BGR image with some noise, so that files have a body to truncate."""
    v, u = np.mgrid[:37, :53]
    smooth = np.stack([4 * u, 5 * v, 2 * u + 2 * v], axis=-1)
    noisy = smooth + np.random.default_rng(0).normal(0, 3, smooth.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("name", ENCODINGS)
@pytest.mark.parametrize("end", [b"", b"\xff\xd9"])
def test_truncated_images_are_refused(tmp_path: Path, name: str, end: bytes) -> None:
    """A JPEG that lacks a part may have its marker of the end."""
    path = tmp_path / name
    cv2.imwrite(str(path), scene(), ENCODINGS[name])
    assert image_size(path) == (53, 37)
    whole = path.read_bytes()
    for fraction in (0.0, 0.005, 0.3, 0.7, 0.95):
        path.write_bytes(whole[: int(fraction * len(whole))] + end)
        for read in (read_image, image_size):
            with pytest.raises(BadData, match=f"{name} cannot be decoded as an image") as caught:
                read(path)
            assert "_io." not in str(caught.value)
    path.unlink()
    with pytest.raises(BadData, match=r"cannot be read \(No such file"):
        read_image(path)


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif", "a.webp"])
@pytest.mark.parametrize("orientation", range(1, 10))
def test_photos_are_turned_and_measured_by_one_orientation(
    name: str, orientation: int, tmp_path: Path
) -> None:
    """The upper left quarter is white; 9 is no orientation."""
    path = tmp_path / name
    stored = np.zeros((32, 48, 3), np.uint8)
    stored[:16, :24] = 255
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    Image.fromarray(stored).save(path, exif=exif, quality=100)
    turned = np.asarray(ImageOps.exif_transpose(Image.open(path)))
    for is_upright, expected in ((True, turned), (False, stored)):
        if name == "a.tif" and orientation > 1 and not is_upright:
            for read in (read_image, image_size):
                with pytest.raises(BadData, match="its pixels are turned by EXIF orientation"):
                    read(path, is_upright=False)
        else:
            image = read_image(path, is_upright=is_upright)
            assert np.abs(image.astype(int) - expected).mean() < 3
            assert image_size(path, is_upright=is_upright) == expected.shape[1::-1]


def test_an_orientation_of_xmp_data_turns_and_measures(tmp_path: Path) -> None:
    xmp = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-'
        'syntax-ns#"><rdf:Description xmlns:tiff="http://ns.adobe.com/tiff/1.0/" '
        'tiff:Orientation="6"/></rdf:RDF></x:xmpmeta>'
    )
    path = tmp_path / "a.jpg"
    Image.new("RGB", (48, 32)).save(path, xmp=xmp.encode())
    assert image_size(path, is_upright=True) == read_image(path).shape[1::-1] == (32, 48)


@pytest.mark.parametrize("mode", ["RGB", "L", "CMYK", "P", "1", "LA", "RGBA"])
def test_colours_are_those_of_pillow(mode: str, tmp_path: Path) -> None:
    colours = Image.fromarray(scene()[..., ::-1]).convert(mode)
    path = tmp_path / ("a.tif" if mode == "CMYK" else "a.png")
    colours.save(path)
    expected = np.asarray(colours.convert("RGB")).astype(int)
    assert np.abs(read_image(path) - expected).max() <= 1


def test_other_content_may_follow_an_image(tmp_path: Path) -> None:
    for name in ("a.png", "a.jpg"):
        cv2.imwrite(str(tmp_path / name), scene())
        with (tmp_path / name).open("ab") as file:
            file.write(b"film" * 10_000)
        assert read_image(tmp_path / name).shape == (37, 53, 3)
        assert image_size(tmp_path / name) == (53, 37)


def test_images_of_16_bits_need_the_number_of_used_bits(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((6, 8, 3), 3000, np.uint16))
    assert np.unique(read_image(path, bits=12)).tolist() == [3000 // 16]
    assert np.unique(read_image(path, bits=16)).tolist() == [3000 // 256]
    for bits, message in (
        (None, r"a\.png holds uint16 values, expected 8 bits a channel"),
        (10, "has the value 3000, more than 10 bits"),
        (17, "8 to 16"),
    ):
        with pytest.raises(BadData, match=message):
            read_image(path, bits=bits)
    cv2.imwrite(str(path), scene())
    with pytest.raises(BadData, match="leave out image_bits"):
        read_image(path, bits=12)


def test_depths_are_metres_and_images_that_are_missing_have_none(tmp_path: Path) -> None:
    path = tmp_path / "depth.png"
    values = np.full((6, 8), 10000, np.uint16)
    cv2.imwrite(str(path), values)
    depths = FrameFiles((path, None), ((8, 6), (8, 6)), read_depth)
    np.testing.assert_array_equal(depths.read(0), np.full((6, 8), 2.0, np.float32))
    np.testing.assert_array_equal(depths.read(1), np.zeros((6, 8)))
    cv2.imwrite(str(path), values.astype(np.uint8))
    with pytest.raises(BadData, match=r"depth\.png holds uint8 in 2 dimensions"):
        depths.read(0)
