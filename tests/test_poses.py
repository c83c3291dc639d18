"""Poses and angles against matrices, OpenCV's rotations, and the circle."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pfslam import poses as P
from pfslam.errors import DataError
from pfslam.poses import Trajectory

angles = st.floats(-100.0, 100.0)
pose = arrays(float, 3, elements=st.floats(-50.0, 50.0))
ROUND_OFF = 1e-11  # a few hundred steps of a double at 100


def matrix(pose):
    """The pose as a 3 x 3 homogeneous matrix: the oracle."""
    x, y, theta = pose
    return np.array([[np.cos(theta), -np.sin(theta), x], [np.sin(theta), np.cos(theta), y], [0, 0, 1]])


def same_pose(a, b):
    np.testing.assert_allclose(matrix(a), matrix(b), atol=ROUND_OFF)


@given(angles)
def test_wrapped_angle_is_the_same_direction_within_minus_pi_excluded_and_pi(theta):
    wrapped = float(P.wrap_angle(theta))
    assert -np.pi < wrapped <= np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(theta), abs=ROUND_OFF)
    assert np.sin(wrapped) == pytest.approx(np.sin(theta), abs=ROUND_OFF)


@pytest.mark.parametrize(
    ("theta", "expected"),
    [
        (0.0, 0.0),
        (np.pi, np.pi),
        (-np.pi, np.pi),
        (3 * np.pi / 2, -np.pi / 2),
        (-7.0, -7.0 + 2 * np.pi),
        (np.nextafter(np.pi, 4), np.pi),
        (np.nextafter(-np.pi, -4), np.pi),
        (np.nextafter(-np.pi, 0), -np.pi),
    ],
)
def test_wrapped_angle_at_the_seam(theta, expected):
    wrapped = P.wrap_angle(theta)
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * expected), abs=1e-15)


def test_mean_of_angles_across_the_seam():
    assert abs(P.average_angle(np.deg2rad([179.0, -179.0]))) == pytest.approx(np.pi)
    # Weights 3 to 1: the mean vector is (3 (1, 0) + (0, 1)) / 4, at atan(1 / 3).
    assert P.average_angle([0.0, np.pi / 2], [3.0, 1.0]) == pytest.approx(np.arctan(1 / 3))


def test_mean_pose_by_hand():
    mean = P.average_pose([[0.0, 0.0, np.pi - 0.1], [4.0, 8.0, -np.pi + 0.1]], [0.75, 0.25])
    np.testing.assert_allclose(mean[:2], [1.0, 2.0])
    # tan of the mean: (0.75 sin 0.1 - 0.25 sin 0.1) / cos 0.1 before pi.
    assert mean[2] == pytest.approx(np.pi - np.arctan(0.5 * np.tan(0.1)))


@given(pose, pose)
def test_compose_multiplies_matrices(a, b):
    np.testing.assert_allclose(matrix(P.compose(a, b)), matrix(a) @ matrix(b), atol=ROUND_OFF)


@given(pose)
def test_invert_inverts_the_matrix(a):
    np.testing.assert_allclose(matrix(P.invert(a)) @ matrix(a), np.eye(3), atol=ROUND_OFF)


@given(pose, pose)
def test_between_is_what_composes_to_the_second_pose(a, b):
    same_pose(P.compose(a, P.between(a, b)), b)


@given(pose, pose)
def test_composed_headings_stay_wrapped(a, b):
    for result in (P.compose(a, b), P.invert(a), P.between(a, b)):
        assert -np.pi < result[2] <= np.pi


def test_compose_broadcasts_over_poses():
    rng = np.random.default_rng(0)
    many, one = rng.normal(size=(5, 3)), rng.normal(size=3)
    each = np.array([P.compose(p, one) for p in many])
    np.testing.assert_array_equal(P.compose(many, one), each)
    np.testing.assert_array_equal(P.compose(one, many), np.array([P.compose(one, p) for p in many]))


@given(pose, arrays(float, (4, 2), elements=st.floats(-30, 30)))
def test_transform_points_multiplies_homogeneous_points(a, points):
    homogeneous = np.column_stack([points, np.ones(4)])
    np.testing.assert_allclose(
        P.transform_points(a, points), (homogeneous @ matrix(a).T)[:, :2], atol=ROUND_OFF
    )


def test_transform_points_of_many_poses_stacks_them():
    rng = np.random.default_rng(1)
    poses, points = rng.normal(size=(3, 3)), rng.normal(size=(7, 2))
    stacked = P.transform_points(poses, points)
    assert stacked.shape == (3, 7, 2)
    for k in range(3):
        np.testing.assert_array_equal(stacked[k], P.transform_points(poses[k], points))


@given(angles, angles, angles)
def test_rotation_is_yaw_after_pitch_after_roll(roll, pitch, yaw):
    about = [cv2.Rodrigues(np.array(axis, float))[0] for axis in ([roll, 0, 0], [0, pitch, 0], [0, 0, yaw])]
    np.testing.assert_allclose(P.rotation_matrix(roll, pitch, yaw), about[2] @ about[1] @ about[0], atol=1e-9)


@given(angles, angles, angles)
def test_the_angles_of_a_rotation_make_the_same_rotation(roll, pitch, yaw):
    rotation = P.rotation_matrix(roll, pitch, yaw)
    found = P.roll_pitch_yaw(rotation)
    assert abs(found[1]) <= np.pi / 2
    np.testing.assert_allclose(P.rotation_matrix(*found), rotation, atol=1e-7)


@given(arrays(float, (5, 3), elements=st.floats(-3.0, 3.0)))
def test_a_quaternion_turns_as_its_axis_and_angle_do(vectors):
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    quaternions = np.hstack([0.5 * np.sinc(half / np.pi) * vectors, np.cos(half)])
    wanted = [cv2.Rodrigues(vector)[0] for vector in vectors]
    np.testing.assert_allclose(P.quaternion_to_rotation(quaternions), wanted, atol=1e-9)


def test_positive_pitch_looks_down():
    ahead = P.rotation_matrix(pitch=np.deg2rad(30)) @ [1, 0, 0]
    np.testing.assert_allclose(ahead, [np.sqrt(3) / 2, 0, -0.5], atol=1e-15)


def test_many_transforms_at_once_are_those_made_one_by_one():
    R = np.stack([P.rotation_matrix(yaw=yaw) for yaw in (0.1, -2.0, 3.0)])
    p = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(P.transform(R, p), [P.transform(*pair) for pair in zip(R, p, strict=True)])
    np.testing.assert_array_equal(P.transform(R), [P.transform(one) for one in R])
    np.testing.assert_array_equal(P.transform(None, p), [P.transform(None, one) for one in p])
    np.testing.assert_array_equal(P.transform(R[0], p), [P.transform(R[0], one) for one in p])


def test_spatial_transform_inverts_and_applies():
    T = P.pose_to_transform([1.0, -2.0, 0.7], z=0.3, pitch=0.2, roll=-0.1)
    points = np.random.default_rng(2).normal(size=(6, 3))
    homogeneous = np.column_stack([points, np.ones(6)])
    np.testing.assert_allclose(P.apply_transform(T, points), (homogeneous @ T.T)[:, :3], atol=1e-14)
    np.testing.assert_allclose(P.invert_transform(T), np.linalg.inv(T), atol=1e-14)


@given(st.integers(0, 2**32 - 1), st.integers(2, 9))
def test_a_chain_of_transforms_leads_between_any_two_frames_of_a_tree(seed, count):
    """A random tree whose frames have places in the world: the chain is the difference of the two places."""
    rng = np.random.default_rng(seed)
    T_wn = [
        P.transform(P.rotation_matrix(*rng.uniform(-3, 3, 3)), rng.uniform(-5, 5, 3)) for _ in range(count)
    ]
    pairs = [(int(rng.integers(k)), k)[:: int(rng.choice([-1, 1]))] for k in range(1, count)]
    known = {(str(a), str(b)): P.invert_transform(T_wn[a]) @ T_wn[b] for a, b in rng.permutation(pairs)}
    start, end = rng.integers(count, size=2)
    found = P.chain_transforms(known, str(start), str(end))
    np.testing.assert_allclose(found, P.invert_transform(T_wn[start]) @ T_wn[end], atol=1e-9)
    assert P.chain_transforms(known, str(start), "elsewhere") is None


def test_spatial_transform_of_a_level_pose_is_the_planar_one():
    points = np.random.default_rng(3).normal(size=(6, 2))
    flat = P.apply_transform(P.pose_to_transform([1.0, 2.0, 0.5]), np.column_stack([points, np.zeros(6)]))
    np.testing.assert_allclose(
        flat, np.column_stack([P.transform_points([1.0, 2.0, 0.5], points), np.zeros(6)]), atol=1e-14
    )


TURN = Trajectory([0.0, 1.0, 3.0], [[0, 0, 3.0], [1, 2, -3.0], [3, 2, -2.0]])


def test_trajectory_interpolates_and_takes_the_short_way_round():
    # From 3.0 to -3.0 the short way is 2 pi - 6 forward, through pi.
    np.testing.assert_allclose(TURN.at(0.25), [0.25, 0.5, 3.0 + 0.25 * (2 * np.pi - 6)])
    np.testing.assert_allclose(TURN.at(2.0), [2.0, 2.0, -2.5])


@given(st.floats(0.0, 3.0))
def test_interpolated_headings_stay_wrapped(t):
    assert -np.pi < TURN.at(t)[2] <= np.pi


@pytest.mark.parametrize("t", [-1e-9, 3.000001, np.nan])
def test_trajectory_refuses_times_outside_its_own(t):
    with pytest.raises(DataError, match=r"Trajectory\.at: t"):
        TURN.at(t)
    with pytest.raises(DataError):
        TURN.at(np.array([1.0, t]))


@pytest.mark.parametrize(
    ("t", "poses"),
    [
        ([0.0, 0.0], np.zeros((2, 3))),
        ([1.0, 0.0], np.zeros((2, 3))),
        ([0.0, np.nan], np.zeros((2, 3))),
        ([0.0, 1.0], [[0, 0, 0], [np.inf, 0, 0]]),
        ([0.0, 1.0], np.zeros((3, 3))),
        ([], np.zeros((0, 3))),
    ],
)
def test_trajectory_refuses_what_is_not_one(t, poses):
    with pytest.raises(DataError):
        Trajectory(t, poses)


@pytest.mark.parametrize(
    ("t", "named"),
    [([0.0, 0.5, 0.5], r"t\[2\]: .*0\.5.* after .*0\.5"), ([0.0, 0.5, 0.4, 0.3], r"t\[2\]: .*0\.4.*")],
)
def test_the_first_time_that_goes_back_is_named(t, named):
    with pytest.raises(DataError, match=named):
        Trajectory(t, np.zeros((len(t), 3)))
