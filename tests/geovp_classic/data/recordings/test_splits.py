"""Named splits hold the documented ranges, and their hash follows from these alone."""

from pathlib import Path

import pytest

from geovp_classic.data.recordings import splits
from geovp_classic.errors import BadData

EXPECTED = {
    "train": "00[0:569) raw0095[0:268) 02[0:300) raw0009[0:400)",
    "train-2026-10": "00[0:569) raw0095[0:268)",
    "val": "00[600:725) 03[0:180)",
    "test": "03[180:360) 06[0:51)",
    "test-colour": "00[757:1018)",
    "deepvo-train": "00 02 08 09",
    "deepvo-test": "03 04 05 06 07 10",
    "forecast-train": "00 02 08 09",
    "forecast-val": "01 04",
    "forecast-test": "03 05 06 07 10",
    "thesis-like-train": "00 02 05 06 08 09",
    "thesis-like-val": "01 04",
    "thesis-like-test": "07 10",
}


def test_named_splits_hold_their_ranges() -> None:
    assert {name: " ".join(map(str, splits.load(name))) for name in splits.names()} == EXPECTED


def test_the_hash_follows_from_the_ranges_alone(tmp_path: Path) -> None:
    path = tmp_path / "other.toml"
    path.write_text('# comment\nranges = [ "03[180:360)",  "06[0:51)" ]')
    # from `printf '03[180:360)\n06[0:51)' | sha256sum`
    digest = "d0e9f82c1cf7af3ed2deda01d675bc811ee49374bf080b996bd049bb575b698a"
    for name in ("test", str(path)):
        assert splits.content_hash(splits.load(name)) == digest
    assert splits.content_hash(splits.load("test")[:1]) != digest
    for name, first in (("train", "2cc28c37"), ("train-2026-10", "79a30f3d")):  # of model cards
        assert splits.content_hash(splits.load(name)).startswith(first)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "No such file"),
        ("ranges = [", "expected ranges"),
        ("", "expected ranges"),
        ("ranges = []", "expected ranges"),
        ("ranges = [6]", "expected ranges"),
        ('ranges = ["06[3:1)"]', "is not a range of frames"),
        ('ranges = ["06"]\nsequences = ["07"]', "expected ranges"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, text: str | None, message: str) -> None:
    if text is not None:
        (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(BadData, match=message):
        splits.load(str(tmp_path / "mine.toml"))
