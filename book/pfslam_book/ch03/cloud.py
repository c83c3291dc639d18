"""Chapter 03, prediction only: many noisy drives at once, and how wide they spread."""

from __future__ import annotations

import numpy as np

from pfslam.evaluation.trajectory import aligned_at_first
from pfslam.motion import Controls, controls, dead_reckoning
from pfslam.particles import ControlNoise
from pfslam.poses import wrap_angle
from pfslam.recording import Recording
from pfslam_book.show.drives import at_rate
from pfslam_book.show.figures import draw_trajectory
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, LINE_STYLES, metric_axes, new_figure

IMU_INTERVAL = 0.01  # s


def fan(inputs: Controls, noise: ControlNoise, n: int, rng: np.random.Generator) -> np.ndarray:
    """Poses ``(K + 1, n, 3)`` of ``n`` particles predicted through all controls from the origin.

    The very numbers that `predict` gives control after control, summed at once; headings are not wrapped.
    """
    tau = np.diff(inputs.t)[:, None]
    scale = 1.0 / np.sqrt(tau) if noise.per_root_second else np.ones_like(tau)
    draws = rng.standard_normal((len(tau), 2, n))
    v = inputs.v[:, None] + scale * noise.sigma_v * draws[:, 0]
    omega = inputs.omega[:, None] + scale * noise.sigma_omega * draws[:, 1]
    theta = _summed(tau * omega)
    x, y = _summed(tau * v * np.cos(theta[:-1])), _summed(tau * v * np.sin(theta[:-1]))
    return np.stack([x, y, theta], axis=-1)


def _summed(steps: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])


def spread(poses: np.ndarray) -> float:
    """Root mean square distance (m) of the particles ``(n, 3)`` from their middle."""
    return float(np.sqrt(np.sum(np.var(poses[:, :2], axis=0))))


def end_spreads(recording: Recording, noise: ControlNoise, seeds: range, n: int = 5) -> np.ndarray:
    """Spread (m) at the end of the drive, one number for each seed."""
    inputs = controls(recording)
    return np.array([spread(fan(inputs, noise, n, np.random.default_rng(seed))[-1]) for seed in seeds])


def fans_picture(recordings: dict[str, tuple[Recording, ControlNoise]], n: int = 5, seed: int = 0) -> Picture:
    """Paths of a few particles for each named recording with its noise: figures 3 and 4 of the report."""
    height = 4.6 if len(recordings) == 1 else 3.9
    figure, grid = new_figure(5.1, height, 1, len(recordings), squeeze=False, sharex=True, sharey=True)
    words = []
    for axes, (name, (recording, noise)) in zip(grid[0], recordings.items(), strict=True):
        paths = fan(controls(recording), noise, n, np.random.default_rng(seed))
        for k in range(n):
            label = None if k else f"{n} particles"
            axes.plot(*paths[::20, k, :2].T, color=COLOURS["particles"], linewidth=1.0, label=label)
        axes.scatter(*paths[-1, :, :2].T, s=30, color=COLOURS["estimate"], zorder=3, label="where they end")
        draw_trajectory(axes, dead_reckoning(recording), "odometry", "no noise")
        metric_axes(axes, name).set_xticks([0, 10, 20])
        words.append(f"{name}: they end {spread(paths[-1]):.1f} m (rms) from their middle")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return Picture(
        figure, f"Paths of {n} particles that leave the same start and fan out. {'; '.join(words)}."
    )


def heading_spread_over_time(
    recording: Recording, rates: tuple[float, ...], noises: dict[float, ControlNoise], n: int = 400
) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """Times (s) and heading spread (deg) of ``n`` particles, for controls at each rate (Hz) with its noise."""
    curves = {}
    for rate in rates:
        inputs = at_rate(controls(recording), rate)
        paths = fan(inputs, noises[rate], n, np.random.default_rng(0))
        every = max(int(rate), 1)
        deviation = np.rad2deg(paths[::every, :, 2].std(axis=1))
        curves[rate] = (inputs.t[::every] - inputs.t[0], deviation)
    return curves


def rates_picture(
    recording: Recording, noise: ControlNoise, rates: tuple[float, ...] = (100.0, 40.0, 10.0)
) -> Picture:
    """Heading spread over time at several rates: noise per sample on the left, per root second on the right."""
    root = np.sqrt(1.0 / rates[0])
    density = ControlNoise(noise.sigma_v * root, noise.sigma_omega * root, per_root_second=True)
    figure, grid = new_figure(5.1, 3.6, 1, 2, sharey=True)
    looks = zip(rates, ("estimate", "highlight", "odometry"), ("-", "-.", "--"), strict=True)
    styles = {rate: {"color": COLOURS[colour], "linestyle": line} for rate, colour, line in looks}
    words = []
    for axes, used, title in zip(grid, (noise, density), ("per sample", "per root second"), strict=True):
        curves = heading_spread_over_time(recording, rates, dict.fromkeys(rates, used))
        for rate, (t, degrees) in curves.items():
            axes.plot(t, degrees, label=f"{rate:.0f} Hz", **styles[rate])
        axes.set(xlabel="time [s]", title=f"noise {title}", xticks=(0, 60, 120))
        ends = ", ".join(f"{d[-1]:.1f} at {rate:.0f} Hz" for rate, (_, d) in curves.items())
        words.append(f"noise {title}: {ends}")
    grid[0].set_ylabel("heading spread [deg]")
    grid[0].legend(fontsize=11)
    return Picture(figure, f"Heading spread over the drive, in degrees at its end. {'; '.join(words)}.")


def honesty(recording: Recording, sigma_omega: float) -> float:
    """Heading error of dead reckoning over the spread that the noise predicts, root mean square over the drive.

    About 1: the belief is honest. Far above: the robot is sure of what is wrong. Far below: it knows more than
    it says. The first second is left out, where both are nothing.
    """
    odometry = dead_reckoning(recording)
    poses, true_poses = aligned_at_first(odometry, recording.true_path())
    error = wrap_angle(poses[:, 2] - true_poses[:, 2])[1:]
    expected = sigma_omega * np.sqrt(np.cumsum(np.diff(odometry.t) ** 2))
    later = odometry.t[1:] > odometry.t[0] + 1.0
    return float(np.sqrt(np.mean((error[later] / expected[later]) ** 2)))


def honesty_picture(recording: Recording, sigmas: tuple[float, ...]) -> Picture:
    """The heading error of dead reckoning against the bands that three noise levels predict."""
    odometry = dead_reckoning(recording)
    poses, true_poses = aligned_at_first(odometry, recording.true_path())
    t = (odometry.t - odometry.t[0])[::20]
    error = np.rad2deg(wrap_angle(poses[:, 2] - true_poses[:, 2]))[::20]
    figure, axes = new_figure(5.1, 3.8)
    looks = zip(sigmas, ("odometry", "highlight", "estimate"), ("--", "-.", "-"), strict=True)
    for sigma, colour, line in looks:
        band = np.rad2deg(sigma * np.sqrt(IMU_INTERVAL * t))
        for sign in (1, -1):
            label = rf"$\sigma_\omega$ = {sigma:.2g} rad/s" if sign == 1 else None
            axes.plot(t, sign * band, color=COLOURS[colour], linestyle=line, label=label)
    axes.plot(t, error, color=COLOURS["truth"], linestyle=LINE_STYLES["truth"], label="true error")
    axes.set(xlabel="time [s]", ylabel="heading [deg]", ylim=(-20, 20), yticks=(-10, 0, 10))
    axes.legend(loc="upper center", ncols=2)
    ends = ", ".join(
        f"{np.rad2deg(s * np.sqrt(IMU_INTERVAL * t[-1])):.1f} deg for {s:.3g} rad/s" for s in sigmas
    )
    alt = f"""The true heading error reaches {np.abs(error).max():.1f} degrees. The spread that the noise predicts
    grows with the root of time; at the end it is {ends}."""
    return Picture(figure, alt)
