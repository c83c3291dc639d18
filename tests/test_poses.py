"""Poses and angles against matrices, OpenCV's rotations, and the circle."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pfslam import poses as P
from pfslam.errors import DataError
from pfslam.motion import motion_model_arc
from pfslam.poses import Trajectory

angles = st.floats(-100.0, 100.0)
pose = arrays(float, 3, elements=st.floats(-50.0, 50.0))
ROUND_OFF = 1e-11  # a few hundred steps of a double at 100


def matrix(pose):
    """The pose as a 3 x 3 homogeneous matrix: the oracle."""
    x, y, theta = pose
    return np.array([[np.cos(theta), -np.sin(theta), x], [np.sin(theta), np.cos(theta), y], [0, 0, 1]])


SEAM = [0.0, np.pi, -np.pi, 3 * np.pi / 2, -7.0]
SEAM += [np.nextafter(np.pi, 4), np.nextafter(-np.pi, -4), np.nextafter(-np.pi, 0)]


@given(st.one_of(angles, st.sampled_from(SEAM)))
def test_wrapped_angle_is_the_same_direction_within_minus_pi_excluded_and_pi(theta):
    wrapped = float(P.wrap_angle(theta))
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * theta), abs=ROUND_OFF)


def test_mean_pose_by_hand():
    mean = P.average_pose([[0.0, 0.0, np.pi - 0.1], [4.0, 8.0, -np.pi + 0.1]], [0.75, 0.25])
    np.testing.assert_allclose(mean[:2], [1.0, 2.0])
    # tan of the mean: (0.75 sin 0.1 - 0.25 sin 0.1) / cos 0.1 before pi.
    assert mean[2] == pytest.approx(np.pi - np.arctan(0.5 * np.tan(0.1)))


@given(
    arrays(float, (2, 3), elements=st.floats(-50.0, 50.0)), arrays(float, (4, 2), elements=st.floats(-30, 30))
)
def test_planar_poses_do_what_their_matrices_do_one_or_many(poses, points):
    a, b = poses
    homogeneous = np.column_stack([points, np.ones(4)])
    for found, expected in (
        (P.compose(a, b), matrix(a) @ matrix(b)),
        (P.invert(a), np.linalg.inv(matrix(a))),
        (P.between(a, b), np.linalg.inv(matrix(a)) @ matrix(b)),
    ):
        np.testing.assert_allclose(matrix(found), expected, atol=ROUND_OFF)
        assert -np.pi < found[2] <= np.pi
    moved = [(homogeneous @ matrix(pose).T)[:, :2] for pose in poses]
    np.testing.assert_allclose(P.transform_points(poses, points), moved, atol=ROUND_OFF)
    np.testing.assert_allclose(P.transform_points(a, points), moved[0], atol=ROUND_OFF)
    np.testing.assert_array_equal(P.compose(poses, b), [P.compose(a, b), P.compose(b, b)])
    np.testing.assert_array_equal(P.compose(b, poses), [P.compose(b, a), P.compose(b, b)])


@given(angles, angles, angles)
def test_rotation_is_yaw_after_pitch_after_roll_and_gives_its_angles_back(roll, pitch, yaw):
    rotation = P.rotation_matrix(roll, pitch, yaw)
    about = [cv2.Rodrigues(np.array(axis, float))[0] for axis in ([roll, 0, 0], [0, pitch, 0], [0, 0, yaw])]
    np.testing.assert_allclose(rotation, about[2] @ about[1] @ about[0], atol=1e-9)
    found = P.roll_pitch_yaw(rotation)
    assert abs(found[1]) <= np.pi / 2
    np.testing.assert_allclose(P.rotation_matrix(*found), rotation, atol=1e-7)


@given(arrays(float, (5, 3), elements=st.floats(-3.0, 3.0)))
def test_a_quaternion_turns_as_its_axis_and_angle_do(vectors):
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    quaternions = np.hstack([0.5 * np.sinc(half / np.pi) * vectors, np.cos(half)])
    wanted = [cv2.Rodrigues(vector)[0] for vector in vectors]
    np.testing.assert_allclose(P.quaternion_to_rotation(quaternions), wanted, atol=1e-9)


def test_spatial_transform_inverts_and_applies():
    angles = [(-0.1, 0.2, 0.7), (1.0, -0.5, 3.0)]
    R, p = np.array([P.rotation_matrix(*a) for a in angles]), np.array([[1.0, -2.0, 0.3], [0.0, 0.0, 1.0]])
    T = P.pose_to_transform([1.0, -2.0, 0.7], z=0.3, pitch=0.2, roll=-0.1)
    np.testing.assert_array_equal(P.transform(R, p)[0], T)
    np.testing.assert_array_equal(P.transform(R)[1], P.transform(R[1]))
    np.testing.assert_array_equal(P.transform(R[0], p)[0], T)
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


TURN = Trajectory([0.0, 1.0, 3.0], [[0, 0, 3.12], [1, 2, -3.12], [3, 2, -3.1]])


@given(arrays(float, st.tuples(st.integers(1, 6), st.just(3)), elements=st.floats(-3.0, 3.0)))
def test_at_its_own_stamps_a_trajectory_has_its_own_poses_to_the_last_bit(poses):
    """At the last one, too: a node that sees no farther reads the same pose as a run that does."""
    path = Trajectory(0.1 * np.arange(len(poses)), poses)
    np.testing.assert_array_equal(path.at(path.t), path.poses)


def test_trajectory_interpolates_and_takes_the_short_way_round():
    # From 3.12 to -3.12 the short way is 2 pi - 6.24 forward, through pi.
    np.testing.assert_allclose(TURN.at(0.25), [0.25, 0.5, 3.12 + 0.25 * (2 * np.pi - 6.24)])
    np.testing.assert_allclose(TURN.at(2.0), [2.0, 2.0, -3.11])


@pytest.mark.parametrize("turn", [-3.1, -0.5, 0.11, 0.9, 3.0])
def test_trajectory_follows_the_arc_that_wheels_of_constant_speed_drive(turn):
    start, t = np.array([1.0, -2.0, 3.0]), np.linspace(0.0, 2.0, 9)
    way = np.array([motion_model_arc(start, 0.7, turn / 2.0, dt) for dt in t])
    read = Trajectory(t[[0, -1]], way[[0, -1]]).at(t)
    np.testing.assert_allclose(read, way, atol=1e-12)
    np.testing.assert_array_equal(read[0], way[0])


def test_where_arcs_begin_a_straight_way_misses_them_by_an_eightieth():
    bends = [Trajectory([0.0, 1.0], [[0, 0, 0], [1, turn / 2, turn]]).at(0.5) for turn in (0.0999, 0.1001)]
    assert 0.01 < np.hypot(*(bends[1] - bends[0])[:2]) < 1 / 79


@pytest.mark.parametrize("t", [-1e-9, 3.000001, np.nan])
def test_trajectory_refuses_times_outside_its_own(t):
    with pytest.raises(DataError, match=r"Trajectory\.at: t"):
        TURN.at(t)
    with pytest.raises(DataError):
        TURN.at(np.array([1.0, t]))


@pytest.mark.parametrize(
    ("t", "poses", "named"),
    [
        ([0.0, 0.5, 0.5], np.zeros((3, 3)), r"t\[2\]: found .*0\.5.* after .*0\.5"),
        ([0.0, 0.5, 0.4, 0.3], np.zeros((4, 3)), r"t\[2\]: found .*0\.4.*"),
        ([0.0, np.nan], np.zeros((2, 3)), "Trajectory: t"),
        ([0.0, 1.0], [[0, 0, 0], [np.inf, 0, 0]], "Trajectory: .*poses"),
        ([0.0, 1.0], np.zeros((3, 3)), "Trajectory: .*poses"),
        ([], np.zeros((0, 3)), "Trajectory: t"),
    ],
)
def test_trajectory_refuses_what_is_not_one_and_names_the_first_time_that_goes_back(t, poses, named):
    with pytest.raises(DataError, match=named):
        Trajectory(t, poses)
