"""Values by hand for corners of the equations."""

import numpy as np
import pytest

from pfslam.evaluation.trajectory import predicted_ranges
from pfslam.grid import GridSpec, OccupancyGrid, free_cells
from pfslam.motion import controls, wheel_distance
from pfslam.particles import ControlNoise, Particles, predict
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Recording
from pfslam.sensors import EncoderModel, LidarModel


class Ones:
    """A random generator whose every draw is one."""

    def standard_normal(self, n):
        return np.ones(n)


@pytest.mark.parametrize(("per_root_second", "scale"), [(False, 1.0), (True, 2.0)])
def test_noise_is_added_to_the_control_and_never_taken_away(per_root_second, scale):
    """Eq. 11 with w = 1 throughout, dt = 1/4 s: v + sigma_v and omega + sigma_omega, or twice the sigmas."""
    noise = ControlNoise(0.4, 0.2, per_root_second)
    moved = predict(Particles.at([1.0, 2.0, 0.0], 3), 1.0, 0.5, 0.25, noise, Ones())
    expected = [1.0 + 0.25 * (1.0 + scale * 0.4), 2.0, 0.25 * (0.5 + scale * 0.2)]
    np.testing.assert_allclose(moved.poses, np.tile(expected, (3, 1)), rtol=1e-14)


def test_the_first_reading_is_travel_before_the_drive():
    """Counts stand for the interval that ends at their stamp, so those of the first reading lie before it."""
    encoders = Encoders(np.array([0.0, 1.0, 2.0]), np.repeat([[7.0], [1.0], [2.0]], 4, axis=1))
    np.testing.assert_allclose(wheel_distance(encoders, EncoderModel(0.5), [0.0, 1.0, 2.0]), [0.0, 0.5, 1.5])


def test_controls_of_a_log_are_its_steps_by_time():
    """Two metres ahead in half a second, then one and a turn of -0.5 rad in two."""
    poses = np.array([[1.0, 1.0, np.pi / 2], [1.0, 3.0, np.pi / 2], [1.0, 4.0, np.pi / 2 - 0.5]])
    found = controls(Recording("log", odometry=Trajectory(np.array([0.0, 0.5, 2.5]), poses)))
    np.testing.assert_allclose(found.v, [4.0, 0.5])
    np.testing.assert_allclose(found.omega, [0.0, -0.25], atol=1e-15)


def free(beams):
    """What a scan of two beams, ten metres away and 45 degrees apart, saw through; cells of 1 m."""
    spec = GridSpec((0.0, 0.0), 1.0, (12, 12))
    ends = np.array([[10.5, 0.5], [10.5, 10.5]])
    return free_cells(spec, ends, np.array(beams), np.array([0.5, 0.5]), "polygon")[0]


def test_what_lies_between_two_neighbouring_beams_is_free_and_a_single_missing_beam_tells_nothing():
    assert free([4, 5])[4, 8] == 1
    assert free([4, 6])[4, 8] == 0
    assert free([4, 6])[0, 5] == 1  # along the beams themselves


@pytest.mark.parametrize(
    ("place", "heading"),
    [((-2.0, 2.0), np.pi), ((6.0, 2.0), 0.0), ((2.0, -2.0), -np.pi / 2), ((2.0, 6.0), np.pi / 2)],
)
def test_nothing_is_met_outside_the_map_even_if_its_border_is_a_wall(place, heading):
    grid = OccupancyGrid.empty(GridSpec((0.0, 0.0), 1.0, (4, 4)))
    grid.log_odds[:] = 1.0
    lidar = LidarModel(0.0, 0.0, 1, range_min=0.1, range_max=8.0, position_b=(0.0, 0.0, 0.0))
    away = np.array([*place, heading])
    assert predicted_ranges(grid, away, lidar)[0] == 8.0
    assert predicted_ranges(grid, away + [0.0, 0.0, np.pi], lidar)[0] < 3.0
