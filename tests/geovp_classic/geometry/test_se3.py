"""SE(3): inverses, and exp and log as inverses, also near the angles 0 and pi."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3

coordinates = st.floats(-50, 50, allow_nan=False)
vectors = st.tuples(coordinates, coordinates, coordinates).map(np.array)
directions = (
    st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
)
MAX_ANGLE_RAD = np.pi - 1e-6


@st.composite
def twists(draw: st.DrawFn) -> np.ndarray:
    """Draw (v, w) with |w| anywhere, tiny, or next to the maximum angle."""
    angles = st.one_of(
        st.floats(0, MAX_ANGLE_RAD),
        st.floats(0, 1e-2),
        st.floats(MAX_ANGLE_RAD - 1e-5, MAX_ANGLE_RAD),
        st.just(0.0),
    )
    axis = draw(directions)
    rotation_vector = axis / np.linalg.norm(axis) * draw(angles)
    return np.concatenate([draw(vectors), rotation_vector])


@given(twists())
def test_log_undoes_exp(twist: np.ndarray) -> None:
    tolerance = 2e-7 * (1 + np.abs(twist).max())
    np.testing.assert_allclose(se3.log(se3.exp(twist)), twist, atol=tolerance)


@given(twists())
def test_exp_is_the_matrix_exponential(twist: np.ndarray) -> None:
    generator = np.zeros((4, 4))
    generator[:3, :3] = se3.cross_matrix(twist[3:])
    generator[:3, 3] = twist[:3]
    np.testing.assert_allclose(se3.exp(twist), scipy.linalg.expm(generator), atol=1e-9)


@given(twists(), twists(), st.lists(st.floats(-0.3, 1.3), min_size=1, max_size=4))
def test_interpolation_follows_the_screw_motion_of_each_step(
    a: np.ndarray, b: np.ndarray, fractions: list[float]
) -> None:
    fraction = np.array(fractions)
    poses = se3.exp(a) @ np.stack([np.eye(4), se3.exp(b)])
    expected = poses[0] @ se3.exp(fraction[:, None] * b)
    interpolated = se3.interpolate(poses, np.array([3.0, 5.0]), 3.0 + 2.0 * fraction)
    np.testing.assert_allclose(interpolated, expected, atol=1e-5)


@given(twists(), vectors, vectors)
def test_transform_keeps_distances_and_matches_the_homogeneous_product(
    twist: np.ndarray, p: np.ndarray, q: np.ndarray
) -> None:
    b_from_a = se3.exp(twist)
    moved = se3.transform(b_from_a, np.stack([p, q]))
    distance = np.linalg.norm(moved[0] - moved[1])
    np.testing.assert_allclose(distance, np.linalg.norm(p - q), atol=1e-9)
    np.testing.assert_allclose(moved[0], (b_from_a @ [*p, 1.0])[:3], atol=1e-10)


def test_orthonormalised_corrects_rounding_and_rejects_other_matrices() -> None:
    exact = se3.exp(np.array([1.0, 2, 3, 0.3, -0.2, 0.5]))
    np.testing.assert_allclose(se3.orthonormalised(np.round(exact, 6)), exact, atol=1e-5)
    mirrored = exact @ np.diag([1.0, 1, -1, 1])
    for bad in (exact * 1.01, mirrored, np.full((4, 4), np.nan)):
        with pytest.raises(BadData, match="rotation matrix"):
            se3.orthonormalised(bad)
