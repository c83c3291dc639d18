"""Chapter 11: step and look of its filter against other ways to the same belief, and its graph against its start."""

import numpy as np
from pfslam_book import ch11

from pfslam.motion import motion_model


def belief(n):
    A = np.random.default_rng(n).normal(size=(n, n))
    return np.linspace(0.5, 2.5, n), 0.01 * (A @ A.T + np.eye(n))


def test_a_step_has_the_moments_of_many_drawn_ones():
    (x, P), Q, rng = belief(5), np.diag([0.03, 0.02]) ** 2, np.random.default_rng(0)
    P, drawn = 0.01 * P, rng.multivariate_normal(x, 0.01 * P, 200_000)
    way, turn = 0.8 + 0.03 * rng.standard_normal(200_000), 0.3 + 0.02 * rng.standard_normal(200_000)
    drawn[:, :3] = motion_model(drawn[:, :3], way, turn, 1.0)
    mean, covariance = ch11.predict(x, P, 0.8, 0.3, Q)
    np.testing.assert_allclose(mean, drawn.mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(covariance, np.cov(drawn.T), atol=3e-5)


def test_a_look_adds_information():
    """Covariance and mean by P'^-1 = P^-1 + H^T R^-1 H, with H from differences."""
    (x, P), R, z = belief(7), np.diag([0.02, 0.001]), np.array([0.9, -1.1])

    def sight(x):
        return np.array([np.hypot(*(x[5:7] - x[:2])), np.arctan2(x[6] - x[1], x[5] - x[0]) - x[2]])

    H = np.column_stack([(sight(x + d) - sight(x - d)) / 2e-6 for d in 1e-6 * np.eye(7)])
    expected = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
    mean, covariance = ch11.update(x, P, z, 5, R)
    np.testing.assert_allclose(covariance, expected, atol=1e-8)
    np.testing.assert_allclose(mean, x + expected @ H.T @ np.linalg.inv(R) @ (z - sight(x)), atol=1e-7)


def test_posts_are_seen_where_they_stand_with_the_noise_that_is_claimed():
    drive = ch11.drive(turn=1.0, seed=3)
    t, k = np.nonzero(drive.seen)
    r, bearing = drive.sights[t, k].T
    direction = drive.path[t, 2] + bearing
    to = drive.posts[k] - drive.path[t, :2]
    ahead = np.sum(to * np.column_stack([np.cos(direction), np.sin(direction)]), axis=1)
    assert drive.seen.any(axis=0).all()
    assert abs(np.std(r - ahead) / np.sqrt(drive.R[0, 0]) - 1.0) < 0.1
    true = np.diff(np.unwrap(drive.path[:, 2]))
    assert abs(np.std(drive.controls[:, 1] - true) / np.deg2rad(1.0) - 1.0) < 0.15


def test_the_graph_ends_where_it_must_from_any_start():
    drive = ch11.drive(seed=1)
    dead = drive.path[:1]
    for way, turn in drive.controls:
        dead = np.vstack([dead, motion_model(dead[-1], way, turn, 1.0)])
    path, posts, P = ch11.smooth(drive, drive.path, drive.posts)
    again, same, _ = ch11.smooth(drive, dead, drive.posts + 0.3)
    np.testing.assert_allclose(path, again, atol=1e-5)
    np.testing.assert_allclose(posts, same, atol=1e-5)
    off = (posts - drive.posts).ravel()
    assert 0.5 < off @ np.linalg.solve(P, off) / len(off) < 1.5  # 60 numbers: 0.64 to 1.36 in 95 %
