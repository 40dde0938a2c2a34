"""The page of splits shows the ranges that the package has."""

from geovp_classic.data.recordings import splits


def test_the_sample_splits_are_disjoint() -> None:
    names = ("train", "val", "test", "test-colour")
    frames = [
        (each.sequence, frame)
        for name in names
        for each in splits.load(name)
        for frame in range(each.first, each.last)
    ]
    assert len(frames) == len(set(frames)) == 1537 + 305 + 231 + 261
