"""Chapter 01, dead reckoning: readings of Eq. 19, steps of Eq. 5, and what a wrong calibration does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes

from pfslam.errors import DataError
from pfslam.evaluation.trajectory import aligned_at_first, trajectory_error
from pfslam.motion import Controls, controls, dead_reckoning, integrate, motion_model, motion_model_arc
from pfslam.poses import wrap_angle
from pfslam.recording import Recording
from pfslam_book.show.drives import at_rate, length
from pfslam_book.show.figures import draw_trajectory
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, LINE_STYLES, metric_axes, new_figure

DRAW_EVERY = 10  # of 100 poses a second, ten are enough for a line


def calibrated(
    recording: Recording,
    gyro_bias: float = 0.0,
    gyro_scale: float = 1.0,
    metres_per_count: float | None = None,
) -> Recording:
    """Return the same readings, understood with another calibration of gyro (rad/s, 1) and wheels (m)."""
    robot = recording.robot
    imu = replace(robot.imu, gyro_bias=gyro_bias, gyro_scale=gyro_scale)
    length = robot.encoders.metres_per_count if metres_per_count is None else metres_per_count
    encoders = replace(robot.encoders, metres_per_count=length)
    return replace(recording, robot=replace(robot, imu=imu, encoders=encoders))


def readings_of_equation_19(recording: Recording) -> dict[str, Controls]:
    """Return three ways to read Eq. 19: as printed, divided by each reading's own interval, and the package's.

    The first two take the encoder reading with the nearest stamp, as the report says.
    """
    inputs, encoders = controls(recording), recording.encoders
    if encoders is None:
        raise DataError(recording.name, "encoders", "none", "a recording with wheel encoders")
    per_reading = encoders.counts.mean(axis=1) * recording.robot.encoders.metres_per_count
    own_interval = per_reading[1:] / np.diff(encoders.t)
    near = nearest(encoders.t[1:], inputs.t[1:])
    return {
        "as printed": replace(inputs, v=per_reading[1:][near]),
        "own interval": replace(inputs, v=own_interval[near]),
        "from the sum": inputs,
    }


def nearest(stamps: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the index of the stamp nearest to each time."""
    after = np.clip(np.searchsorted(stamps, t), 1, len(stamps) - 1)
    return after - (t - stamps[after - 1] < stamps[after] - t)


def distance(inputs: Controls) -> float:
    """Return the distance (m) that a list of controls drives."""
    return float(inputs.v @ np.diff(inputs.t))


def path_picture(recording: Recording) -> Picture:
    """Draw the path as the robot computes it from wheels and gyro, and nothing else."""
    odometry = dead_reckoning(recording)
    figure, axes = new_figure(5.0, 4.4)
    draw_trajectory(axes, odometry, "odometry", "wheels and gyro")
    x, y = odometry.poses[[0, -1], :2].T
    axes.scatter(x[0], y[0], s=140, color=COLOURS["truth"], marker="*", zorder=4, label="start")
    axes.scatter(x[1], y[1], s=90, color=COLOURS["highlight"], marker="s", zorder=4, label="end")
    metric_axes(axes).legend(loc="center right")
    alt = f"""A path of {length(odometry):.0f} metres drawn from wheels and gyro alone: two long arms at a right
    angle, each driven out and back. It starts at (0, 0) and ends at ({x[1]:.1f}, {y[1]:.1f}) metres."""
    return Picture(figure, alt)


def two_paths_picture(recordings: dict[str, Recording]) -> Picture:
    """Draw figures 1 and 2 of the report, with the truth that the report did not have."""
    figure, grid = new_figure(5.0, 3.4, 1, 2, sharex=True, sharey=True)
    words = []
    for axes, (name, recording) in zip(grid, recordings.items(), strict=True):
        odometry, truth = dead_reckoning(recording), recording.true_path()
        draw_trajectory(axes, truth, "truth")
        draw_trajectory(axes, odometry, "odometry", "dead reckoning")
        metric_axes(axes, name).set_xticks([0, 10, 20])
        error = trajectory_error(odometry, truth)
        words.append(f"{name}: at most {error.ate_max_m:.1f} m from the truth")
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return Picture(figure, f"True and dead-reckoned path of two drives, side by side. {'; '.join(words)}.")


def speed_picture(recording: Recording, seconds: float = 12.0) -> Picture:
    """Draw the speed over time around the worst spike: two readings of Eq. 19, and the second over longer intervals."""
    readings = readings_of_equation_19(recording)
    readings["from the sum, 10 a second"] = at_rate(readings["from the sum"], 10.0)
    start = readings["own interval"].t[1 + np.argmax(readings["own interval"].v)] - seconds / 2
    figure, axes = new_figure(5.0, 4.6)
    looks = {
        "own interval": (COLOURS["odometry"], 1.2),
        "from the sum": (COLOURS["estimate"], 0.7),
        "from the sum, 10 a second": (COLOURS["estimate"], 2.4),
    }
    for name, (colour, width) in looks.items():
        inputs = readings[name]
        shown = (inputs.t[1:] >= start) & (inputs.t[1:] < start + seconds)
        t = inputs.t[1:][shown] - inputs.t[0]
        axes.plot(t, inputs.v[shown], color=colour, linewidth=width, label=name)
    axes.axhline(1.4, color=COLOURS["truth"], linestyle=LINE_STYLES["truth"], label="top speed of the robot")
    axes.set(xlabel="time [s]", ylabel="speed [m/s]", ylim=(0.0, None))
    axes.legend(loc="upper center", bbox_to_anchor=(0.45, -0.18), ncols=1)
    worst = {name: readings[name].v.max() for name in looks}
    alt = f"""Speed over {seconds:.0f} seconds around the worst spike of the drive. Divided by each reading's own
    interval it reaches {worst["own interval"]:.1f} m/s; differences of the sum at each gyro sample,
    {worst["from the sum"]:.1f} m/s; differences ten times a second, {worst["from the sum, 10 a second"]:.1f} m/s.
    The robot never exceeds 1.4 m/s."""
    return Picture(figure, alt)


def arcs_picture(radius: float = 1.3, track: float = 0.7, angle: float = 0.9) -> Picture:
    """Draw two arcs about one centre: what the wheels on either side travel while the robot turns."""
    figure, axes = new_figure(5.0, 4.2)
    turn = np.linspace(0.0, angle, 60)
    ways = (
        ("left", radius - track / 2, "odometry"),
        ("centre", radius, "truth"),
        ("right", radius + track / 2, "odometry"),
    )
    for name, r, kind in ways:
        axes.plot(r * np.cos(turn), r * np.sin(turn), color=COLOURS[kind])
        middle = 0.62 * angle
        words = {"left": "$s_L$", "centre": "$s$", "right": "$s_R$"}[name]
        axes.annotate(
            words, (r * np.cos(middle), r * np.sin(middle)), xytext=(5, 4), textcoords="offset points"
        )
    for at in (0.0, angle):
        axes.plot(
            [0, (radius + track) * np.cos(at)],
            [0, (radius + track) * np.sin(at)],
            color=COLOURS["unknown"],
            zorder=0,
        )
        _draw_chassis(axes, radius, track, at)
    axes.plot(0, 0, marker="o", color=COLOURS["highlight"], markersize=9)
    axes.text(0.0, -0.09, "centre of the turn", ha="left", va="top")
    axes.plot(0.32 * np.cos(turn), 0.32 * np.sin(turn), color=COLOURS["highlight"])
    axes.text(0.36 * np.cos(angle / 2), 0.36 * np.sin(angle / 2) - 0.04, r"$\varphi$")
    axes.annotate("", (radius, -0.28), (0, -0.28), arrowprops={"arrowstyle": "<->"})
    axes.text(0.5 * radius, -0.3, "$R$", ha="center", va="top")
    axes.annotate(
        "", (radius + track / 2, -0.5), (radius - track / 2, -0.5), arrowprops={"arrowstyle": "<->"}
    )
    axes.text(radius, -0.52, "$W$", ha="center", va="top")
    axes.set(aspect="equal", xlim=(-0.15, 2.15), ylim=(-0.68, 1.7))
    axes.axis("off")
    alt = """A robot turns left about a centre. Its left wheels run along an arc of radius R minus W/2, its right wheels
    along one of radius R plus W/2, and its middle along the arc of radius R between them; all three arcs have the same
    angle at the centre, by which the robot has turned."""
    return Picture(figure, alt)


def _draw_chassis(axes: Axes, radius: float, track: float, at: float) -> None:
    """Draw a robot that drives round the origin, after the angle ``at`` (rad): chassis, four wheels and heading."""
    ahead, out = np.array([-np.sin(at), np.cos(at)]), np.array([np.cos(at), np.sin(at)])
    corners = [(-0.2, -0.25), (-0.2, 0.25), (0.2, 0.25), (0.2, -0.25)]
    middle = radius * out
    axes.fill(
        *np.transpose([middle + a * ahead + b * out for a, b in corners]), color=COLOURS["unknown"], alpha=0.6
    )
    for a in (-0.13, 0.13):
        for b in (-track / 2, track / 2):
            ends = np.array([middle + (a + c) * ahead + b * out for c in (-0.1, 0.1)])
            axes.plot(*ends.T, color=COLOURS["truth"], linewidth=5, solid_capstyle="butt")
    arrow = {"arrowstyle": "-|>", "color": COLOURS["truth"], "linewidth": 2}
    axes.annotate("", tuple(middle + 0.42 * ahead), tuple(middle), arrowprops=arrow)


def circle_picture(v: float = 1.0, omega: float = 0.8, seconds: float = 7.0) -> Picture:
    """Draw Euler steps of two sizes against the arc that the robot drives."""
    figure, axes = new_figure(5.0, 4.6)
    exact = _circle(v, omega, seconds, 0.01, motion_model_arc)
    axes.plot(*exact[:, :2].T, color=COLOURS["truth"], linestyle=LINE_STYLES["truth"], label="exact arc")
    gaps = []
    for tau, kind, marker in ((1.0, "odometry", "s"), (0.5, "estimate", "o")):
        path = _circle(v, omega, seconds, tau, motion_model)
        gaps.append(f"{np.hypot(*(path[-1] - exact[-1])[:2]):.2f} m for {tau:g} s")
        label = rf"Euler, $\tau$ = {tau:g} s"
        axes.plot(
            *path[:, :2].T, color=COLOURS[kind], marker=marker, linewidth=1.2, markersize=5, label=label
        )
    axes.plot(0, 0, marker="*", markersize=14, color=COLOURS["truth"], linestyle="none", label="start")
    metric_axes(axes).legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
    alt = f"""A robot drives {seconds:.0f} seconds round a circle of {v / omega:.2f} m radius. The corners of its Euler
    steps lie on circles of nearly the same size, turned about the starting point: outside the true circle on the right,
    inside on the left. Their ends are off by {", ".join(gaps)}."""
    return Picture(figure, alt)


def _circle(v: float, omega: float, seconds: float, tau: float, model) -> np.ndarray:
    steps = round(seconds / tau)
    inputs = Controls(tau * np.arange(steps + 1), np.full(steps, v), np.full(steps, omega))
    return integrate(inputs, model=model).poses


def heading_errors(recording: Recording, calibrations: dict[str, dict]) -> dict[str, np.ndarray]:
    """Return the heading error over time, degrees, ``(K, 2)`` with the time first, for each named calibration."""
    errors = {}
    for name, calibration in calibrations.items():
        odometry = dead_reckoning(calibrated(recording, **calibration))
        poses, true_poses = aligned_at_first(odometry, recording.true_path())
        error = np.rad2deg(wrap_angle(poses[:, 2] - true_poses[:, 2]))
        errors[name] = np.column_stack([odometry.t - odometry.t[0], error])
    return errors


def heading_error_picture(recording: Recording, calibrations: dict[str, dict]) -> Picture:
    """Draw the heading error over time: one curve for each calibration."""
    figure, axes = new_figure(5.0, 4.3)
    styles = zip(("odometry", "highlight", "estimate"), ("--", "-.", "-"), strict=True)
    words = []
    for (name, error), (colour, line) in zip(
        heading_errors(recording, calibrations).items(), styles, strict=True
    ):
        t, degrees = error[::DRAW_EVERY].T
        axes.plot(t, degrees, color=COLOURS[colour], linestyle=line, label=name)
        words.append(f"{name} between {error[:, 1].min():.1f} and {error[:, 1].max():.1f}")
    axes.set(xlabel="time [s]", ylabel="heading error [deg]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.45, -0.18), ncols=1)
    return Picture(figure, f"Heading error over the drive in degrees: {'; '.join(words)}.")
