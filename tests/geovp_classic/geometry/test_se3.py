"""SE(3) as a group: axioms, exp and log as inverses, right near 0 and near pi."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3

coordinates = st.floats(-50, 50, allow_nan=False)
vectors = st.tuples(coordinates, coordinates, coordinates).map(np.array)
directions = (
    st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
)


@st.composite
def twists(draw: st.DrawFn, max_angle_rad: float = np.pi - 1e-6) -> np.ndarray:
    """(v, w) with |w| drawn evenly, or tiny, or next to the greatest angle."""
    angle_rad = draw(
        st.one_of(
            st.floats(0, max_angle_rad),
            st.floats(0, 1e-5),
            st.floats(max_angle_rad - 1e-5, max_angle_rad),
            st.just(0.0),
        )
    )
    axis = draw(directions)
    return np.concatenate([draw(vectors), axis / np.linalg.norm(axis) * angle_rad])


@given(twists())
def test_log_undoes_exp(twist: np.ndarray) -> None:
    np.testing.assert_allclose(
        se3.log(se3.exp(twist)), twist, atol=2e-7 * (1 + np.abs(twist).max())
    )


@given(twists(), twists(), twists())
def test_motions_form_a_group(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    x, y, z = se3.exp(a), se3.exp(b), se3.exp(c)
    np.testing.assert_allclose((x @ y) @ z, x @ (y @ z), atol=1e-10)
    np.testing.assert_allclose(x @ se3.inverse(x), np.eye(4), atol=1e-12 * (1 + np.abs(a).max()))
    np.testing.assert_allclose(se3.inverse(x @ y), se3.inverse(y) @ se3.inverse(x), atol=1e-10)
    product = x @ y
    np.testing.assert_allclose(product[:3, :3] @ product[:3, :3].T, np.eye(3), atol=1e-12)


@given(twists())
def test_exp_is_the_matrix_exponential(twist: np.ndarray) -> None:
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = se3.cross_matrix(twist[3:]), twist[:3]
    np.testing.assert_allclose(se3.exp(twist), scipy.linalg.expm(generator), atol=1e-9)


@given(twists(), twists(), st.floats(0, 1), st.floats(0, 1))
def test_interpolation_is_a_one_parameter_motion(
    a: np.ndarray, b: np.ndarray, s: float, t: float
) -> None:
    world_from_a = se3.exp(a)
    world_from_b = world_from_a @ se3.exp(b)
    np.testing.assert_allclose(
        se3.interpolate(world_from_a, world_from_b, 0.0), world_from_a, atol=1e-9
    )
    np.testing.assert_allclose(
        se3.interpolate(world_from_a, world_from_b, 1.0), world_from_b, atol=1e-5
    )
    halfway = se3.interpolate(world_from_a, world_from_b, s)
    np.testing.assert_allclose(halfway, world_from_a @ se3.exp(s * b), atol=1e-5)
    within = se3.interpolate(world_from_a, halfway, t)
    np.testing.assert_allclose(
        within, se3.interpolate(world_from_a, world_from_b, s * t), atol=1e-5
    )


@given(twists(), vectors, vectors)
def test_transform_keeps_distances_and_matches_homogeneous_product(
    twist: np.ndarray, p: np.ndarray, q: np.ndarray
) -> None:
    b_from_a = se3.exp(twist)
    moved = se3.transform(b_from_a, np.stack([p, q]))
    np.testing.assert_allclose(
        np.linalg.norm(moved[0] - moved[1]), np.linalg.norm(p - q), atol=1e-9
    )
    np.testing.assert_allclose(moved[0], (b_from_a @ [*p, 1.0])[:3], atol=1e-10)


def test_leading_axes_are_kept() -> None:
    twist = np.random.default_rng(0).normal(size=(2, 5, 6)) * 0.5
    motions = se3.exp(twist)
    assert motions.shape == (2, 5, 4, 4)
    np.testing.assert_allclose(se3.log(motions), twist, atol=1e-12)
    assert se3.transform(motions, np.zeros((2, 5, 7, 3))).shape == (2, 5, 7, 3)


def test_quarter_turn_on_a_circle() -> None:
    # Driving along x while turning about z by 90 degrees on an arc of length 10 * pi / 2 ends at
    # (10, 10).
    end = se3.exp(np.array([10 * np.pi / 2, 0, 0, 0, 0, np.pi / 2]))
    np.testing.assert_allclose(end[:3, 3], [10, 10, 0], atol=1e-12)
    assert se3.rotation_angle_rad(end) == pytest.approx(np.pi / 2)


def test_orthonormalised_mends_rounding_and_refuses_the_rest() -> None:
    exact = se3.exp(np.array([1.0, 2, 3, 0.3, -0.2, 0.5]))
    np.testing.assert_allclose(se3.orthonormalised(np.round(exact, 6)), exact, atol=1e-5)
    mirrored = exact @ np.diag([1.0, 1, -1, 1])
    for bad in (exact * 1.01, mirrored, np.full((4, 4), np.nan)):
        with pytest.raises(BadData, match="rotation matrix"):
            se3.orthonormalised(bad)


@given(twists(), twists())
def test_a_turn_leads_from_one_rotation_to_the_other_and_leaves_the_position(
    a: np.ndarray, b: np.ndarray
) -> None:
    c_from_a, c_from_b = se3.exp(a), se3.exp(b)
    led = se3.turned(c_from_a, se3.turn(c_from_a, c_from_b))
    np.testing.assert_allclose(led[:3, :3], c_from_b[:3, :3], atol=1e-9)
    np.testing.assert_array_equal(led[:3, 3], c_from_a[:3, 3])


def test_vectors_that_nobody_may_write_to() -> None:
    vectors = np.array([[0.0, 0, 0, 0, 0, np.pi / 2]])
    vectors.flags.writeable = False
    quarter_turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(se3.exp(vectors)[0, :3, :3], quarter_turn, atol=1e-12)


@pytest.mark.parametrize("angle_rad", [1e-4, 9.9e-4, 1.01e-3, 0.01])
def test_series_and_formula_agree_with_the_matrix_exponential_where_they_meet(
    angle_rad: float,
) -> None:
    twist = np.array([50.0, -20, 30, *(angle_rad * np.array([0.6, 0, 0.8]))])
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = se3.cross_matrix(twist[3:]), twist[:3]
    np.testing.assert_allclose(se3.exp(twist), scipy.linalg.expm(generator), atol=1e-8)
    np.testing.assert_allclose(se3.log(se3.exp(twist)), twist, atol=1e-8)


def test_how_far_from_a_rotation_is_too_far() -> None:
    rounded = np.eye(4)
    rounded[0, 0] = 1 + 1e-3  # its square is off by 2.001e-3
    np.testing.assert_allclose(
        se3.orthonormalised(rounded, tolerance=2.01e-3), np.eye(4), atol=1e-12
    )
    with pytest.raises(BadData, match=r"off by 0\.002, expected orthonormal rows within 0\.00199"):
        se3.orthonormalised(rounded, tolerance=1.99e-3)
    with pytest.raises(BadData, match=r"within 0\.0001"):
        se3.orthonormalised(rounded)


@given(st.lists(twists(), min_size=1, max_size=5))
def test_rotation_vectors_are_scipys(several: list[np.ndarray]) -> None:
    turned = se3.exp(np.stack(several))
    expected = Rotation.from_matrix(turned[:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(se3.turn(np.eye(4), turned), expected, atol=1e-9)
