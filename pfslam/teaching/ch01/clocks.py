"""Chapter 01, clocks and counts: what is lost when readings are paired instead of added up."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from pfslam.motion import controls, wheel_distance
from pfslam.recording import Recording
from pfslam.teaching.ch01.odometry import distance, nearest, readings_of_equation_19
from pfslam.teaching.show.drives import at_rate, length
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import COLOURS, LINE_STYLES, new_figure
from pfslam.teaching.show.widgets import Explorer, Slider

SHOWN = 8.0  # s around the worst spike


def counts_picture(recording: Recording, start: float, seconds: float = 4.0) -> Picture:
    """The same counts of one wheel as two robots may report them: since the last reading, or in all."""
    encoders, _ = recording.wheels_and_gyro()
    shown = (encoders.t >= encoders.t[0] + start) & (encoders.t < encoders.t[0] + start + seconds)
    t, counts = encoders.t[shown] - encoders.t[0], encoders.counts[shown, 0]
    total = np.cumsum(encoders.counts[:, 0])[shown]
    figure, axes = new_figure(6.2, 2.9, columns=2)
    for ax, values, name in zip(axes, (counts, total), "AB", strict=True):
        ax.plot(t, values, color=COLOURS["odometry"], marker=".", markersize=4, linewidth=0.8)
        ax.set(xlabel="time [s]", title=f"robot {name}")
    axes[0].set(ylabel="counts", ylim=(0, None))
    axes[1].locator_params(axis="y", nbins=4)
    alt = f"""Counts of one wheel over {seconds:.0f} seconds from two robots. A: {len(counts)} values that hop between
    {counts.min()} and {counts.max()}; they sum to {counts.sum()}. B: values that rise steadily from {total[0]} to
    {total[-1]}."""
    return Picture(figure, alt)


def paired_lengths(recording: Recording, every: int) -> tuple[float, float]:
    """Metres driven at every ``every``-th scan: the nearest reading of each scan, and differences of the sum."""
    encoders, _ = recording.wheels_and_gyro()
    model, stamps = recording.robot.encoders, recording.scans().t[::every]
    inside = stamps[(stamps >= encoders.t[0]) & (stamps <= encoders.t[-1])]
    per_reading = encoders.counts.mean(axis=1) * model.metres_per_count
    return float(per_reading[nearest(encoders.t, inside)].sum()), float(
        np.diff(wheel_distance(encoders, model, inside)).sum()
    )


def without_gyro(recording: Recording, start: float, seconds: float) -> Recording:
    """The recording with the gyro silent for ``seconds`` from ``start``, both counted from its first sample."""
    _, imu = recording.wheels_and_gyro()
    t = imu.t - imu.t[0]
    kept = (t < start) | (t >= start + seconds)
    silent = replace(
        imu,
        t=imu.t[kept],
        angular_velocity=imu.angular_velocity[kept],
        acceleration_g=imu.acceleration_g[kept],
    )
    return replace(recording, imu=silent)


def length_if_gyro_spoke(recording: Recording) -> float:
    """Metres that remain if an encoder reading without a gyro sample in its interval leaves the pose as it was."""
    encoders, imu = recording.wheels_and_gyro()
    samples = np.diff(np.searchsorted(imu.t, encoders.t, side="right"))
    per_reading = encoders.counts.mean(axis=1)[1:] * recording.robot.encoders.metres_per_count
    return float(per_reading[samples > 0].sum())


def draw_speed(recording: Recording, milliseconds: float) -> Figure:
    """Speed over time, read off on an even clock: from each reading's own interval, and from the sum."""
    own, summed = _read_off(recording, milliseconds)
    start = _spike(recording) - SHOWN / 2
    figure, axes = new_figure(6.2, 3.6)
    looks = (
        (own, "own interval, nearest", "odometry", 1.0),
        (summed, "from the sum", "estimate", 2.2),
    )
    for inputs, name, colour, width in looks:
        shown = (inputs.t[1:] >= start) & (inputs.t[1:] < start + SHOWN)
        t, v = inputs.t[1:][shown] - inputs.t[0], inputs.v[shown]
        axes.step(
            t,
            v,
            where="pre",
            color=COLOURS[colour],
            linewidth=width,
            label=f"{name}: {distance(inputs):.1f} m",
        )
    axes.axhline(1.4, color=COLOURS["truth"], linestyle=LINE_STYLES["truth"])
    axes.set(xlabel="time [s]", ylabel="speed [m/s]", ylim=(0.0, 12.5))
    axes.legend(loc="upper right", fontsize=11)
    return figure


def describe_speed(recording: Recording, milliseconds: float) -> str:
    """The same in words."""
    own, summed = _read_off(recording, milliseconds)
    return f"""Speed read off every {milliseconds:g} ms. Nearest reading divided by its own interval: top speed
    {own.v.max():.1f} m/s, {distance(own):.1f} m in all. Differences of the sum: top speed {summed.v.max():.1f} m/s,
    {distance(summed):.1f} m in all. The true distance is {length(recording.true_path()):.1f} m."""


def _read_off(recording: Recording, milliseconds: float):
    """The two readings of Eq. 19 on an even clock, as controls."""
    summed = at_rate(controls(recording), 1000.0 / milliseconds)
    encoders, _ = recording.wheels_and_gyro()
    per_reading = encoders.counts.mean(axis=1)[1:] * recording.robot.encoders.metres_per_count
    own_interval = per_reading / np.diff(encoders.t)
    return replace(summed, v=own_interval[nearest(encoders.t[1:], summed.t[1:])]), summed


def _spike(recording: Recording) -> float:
    """Time (s) of the worst spike of speed if each reading is divided by its own interval."""
    own = readings_of_equation_19(recording)["own interval"]
    return float(own.t[1 + np.argmax(own.v)])


def speed_explorer(recording: Recording) -> Explorer:
    """One slider: how long the interval is over which a speed is read off."""
    return Explorer(
        partial(draw_speed, recording),
        [
            Slider(
                "milliseconds",
                (10, 20, 40, 80, 160, 320, 640, 1280),
                0,
                "Read off every",
                "ms",
                "g",
                (5.0, 2000.0, 5.0),
            )
        ],
        alt=partial(describe_speed, recording),
        title="Speed needs an interval, distance does not",
    )
