"""Where things are: planar poses SE(2), spatial transforms SE(3), angles, and trajectories.

A planar pose is an array ``(x, y, theta)`` in metres and radians; many poses are an array ``(N, 3)``.
``pose_wb`` places the body frame in the world: it turns body coordinates into world coordinates. A spatial
transform ``T_wb`` is the 4 x 4 matrix that does the same. Adjacent letters cancel: ``T_wo = T_wb @ T_bo``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError

ARC = 0.1
"""Turn (rad) between two poses beyond which the way is an arc; a straight one misses it by an 80th of its length."""


def wrap_angle(theta):
    """Angle(s) in radians, brought into (-pi, pi].

    >>> round(float(np.degrees(wrap_angle(np.radians(270.0)))))
    -90
    """
    wrapped = np.pi - (np.pi - np.asarray(theta, dtype=float)) % (2.0 * np.pi)
    return np.where(wrapped > -np.pi, wrapped, np.pi)[()]  # just above pi the remainder rounds to 2 pi


def average_angle(theta, weights=None) -> float:
    """Mean direction of angles ``(N,)`` with optional ``weights`` ``(N,)``, in radians.

    The mean of the unit vectors is taken, so that 179 and -179 degrees average to 180, not to 0.

    >>> round(float(np.degrees(average_angle(np.radians([170.0, -170.0])))))
    180
    """
    sin, cos = np.sin(theta), np.cos(theta)
    weights = np.ones_like(sin) if weights is None else np.asarray(weights)
    return float(np.arctan2((sin * weights).sum() / weights.sum(), (cos * weights).sum() / weights.sum()))


def average_pose(poses, weights=None) -> np.ndarray:
    """Weighted mean of poses ``(N, 3)`` as one pose ``(3,)``; the heading is averaged on the circle."""
    poses = np.asarray(poses, dtype=float)
    weights = np.ones(len(poses)) if weights is None else np.asarray(weights)
    x, y = (poses[:, :2] * weights[:, None]).sum(axis=0) / weights.sum()
    return np.array([x, y, average_angle(poses[:, 2], weights)])


def compose(pose_ab, pose_bc) -> np.ndarray:
    """``pose_ac``: first ``pose_ab``, then ``pose_bc`` in its frame. Shapes ``(..., 3)`` broadcast.

    >>> compose([1.0, 0.0, np.pi / 2], [2.0, 0.0, 0.0]).round(2).tolist()
    [1.0, 2.0, 1.57]
    """
    a, b = np.asarray(pose_ab, dtype=float), np.asarray(pose_bc, dtype=float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return _side_by_side(x, y, wrap_angle(a[..., 2] + b[..., 2]))


def invert(pose_ab) -> np.ndarray:
    """``pose_ba``, so that ``compose(pose_ab, pose_ba)`` is the identity. Shape ``(..., 3)``.

    >>> invert([1.0, 2.0, 0.0]).tolist()
    [-1.0, -2.0, 0.0]
    """
    a = np.asarray(pose_ab, dtype=float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = -c * a[..., 0] - s * a[..., 1]
    y = s * a[..., 0] - c * a[..., 1]
    return _side_by_side(x, y, wrap_angle(-a[..., 2]))


def between(pose_wa, pose_wb) -> np.ndarray:
    """``pose_ab``: pose b seen from pose a, both given in the world. Shapes ``(..., 3)`` broadcast.

    >>> between([1.0, 0.0, 0.0], [3.0, 0.0, 0.0]).tolist()
    [2.0, 0.0, 0.0]
    """
    return compose(invert(pose_wa), pose_wb)


def transform_points(pose_ab, points_b) -> np.ndarray:
    """Points ``(M, 2)`` of frame b in frame a, for one pose ``(3,)``; ``(N, M, 2)`` for poses ``(N, 3)``.

    >>> transform_points([1.0, 0.0, np.pi / 2], [[2.0, 0.0]]).round(2).tolist()
    [[1.0, 2.0]]
    """
    pose, points = np.asarray(pose_ab, dtype=float), np.asarray(points_b, dtype=float)
    c, s = np.cos(pose[..., 2, None]), np.sin(pose[..., 2, None])
    x = pose[..., 0, None] + c * points[:, 0] - s * points[:, 1]
    y = pose[..., 1, None] + s * points[:, 0] + c * points[:, 1]
    return _side_by_side(x, y)


def _side_by_side(*columns: np.ndarray) -> np.ndarray:
    """Stack arrays of one shape along a new last axis: ``np.stack(columns, axis=-1)`` in a third of its time."""
    stacked = np.empty((*np.shape(columns[0]), len(columns)))
    for k, column in enumerate(columns):
        stacked[..., k] = column
    return stacked


def rotation_matrix(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """Rotation ``Rz(yaw) Ry(pitch) Rx(roll)``, shape ``(3, 3)``; positive pitch turns x (forward) down."""
    cr, sr, cp, sp, cy, sy = (float(f(angle)) for angle in (roll, pitch, yaw) for f in (np.cos, np.sin))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def roll_pitch_yaw(rotation: np.ndarray) -> tuple[float, float, float]:
    """The angles (rad) of ``rotation_matrix`` for a rotation ``(3, 3)``, pitch in [-pi/2, pi/2].

    >>> [round(angle, 9) for angle in roll_pitch_yaw(rotation_matrix(0.1, -0.2, 3.0))]
    [0.1, -0.2, 3.0]
    """
    R = np.asarray(rotation, dtype=float)
    roll, yaw = np.arctan2(R[[2, 1], [1, 0]], R[[2, 0], [2, 0]]).tolist()
    return roll, float(-np.arcsin(np.clip(R[2, 0], -1.0, 1.0))), yaw


def quaternion_to_rotation(xyzw) -> np.ndarray:
    """Rotations ``(..., 3, 3)`` of unit quaternions ``(..., 4)``, the real part last.

    >>> quaternion_to_rotation([0.0, 0.0, 1.0, 0.0]).tolist()  # half a turn about z
    [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    q = np.asarray(xyzw, dtype=float)[..., None, :]
    cross = np.cross(np.eye(3), q[..., :3])
    return np.eye(3) + 2.0 * q[..., 3:] * cross + 2.0 * cross @ cross


def transform(rotation=None, translation=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Transforms ``(..., 4, 4)`` of rotations ``(..., 3, 3)``, identity if None, and translations ``(..., 3)`` in m."""
    R = np.eye(3) if rotation is None else np.asarray(rotation)
    T = np.tile(np.eye(4), (*np.broadcast_shapes(R.shape[:-2], np.shape(translation)[:-1]), 1, 1))
    T[..., :3, :3] = R
    T[..., :3, 3] = translation
    return T


def pose_to_transform(pose_wb, z: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> np.ndarray:
    """``T_wb``, shape ``(4, 4)``, of a planar pose; height (m), pitch and roll (rad) for slopes."""
    x, y, theta = pose_wb
    return transform(rotation_matrix(roll, pitch, theta), (x, y, z))


def invert_transform(T_ab: np.ndarray) -> np.ndarray:
    """``T_ba``, shape ``(4, 4)``."""
    R, p = T_ab[:3, :3], T_ab[:3, 3]
    return transform(R.T, -R.T @ p)


def chain_transforms(known: Mapping[tuple[str, str], np.ndarray], start: str, end: str) -> np.ndarray | None:
    """``T_start_end``, shape ``(4, 4)``, along a chain of known transforms, or None where no chain joins the two.

    ``known`` holds ``T_ab`` for pairs of frames ``(a, b)``; a chain may use each of them from either side.

    >>> arm, hand = transform(translation=(1.0, 0.0, 0.0)), transform(translation=(0.0, 2.0, 0.0))
    >>> chain_transforms({("hand", "arm"): hand, ("body", "arm"): arm}, "body", "hand")[:3, 3].tolist()
    [1.0, -2.0, 0.0]
    """
    reached = {start: np.eye(4)}
    for _ in known:
        for (a, b), T_ab in known.items():
            if a in reached:
                reached.setdefault(b, reached[a] @ T_ab)
            elif b in reached:
                reached[a] = reached[b] @ invert_transform(T_ab)
    return reached.get(end)


def apply_transform(T_ab: np.ndarray, points_b) -> np.ndarray:
    """Points ``(..., 3)`` of frame b, in frame a.

    >>> T_wb = transform(translation=(1.0, 0.0, 0.5))
    >>> apply_transform(T_wb, [[2.0, 0.0, 0.0]]).tolist()
    [[3.0, 0.0, 0.5]]
    """
    return np.asarray(points_b) @ T_ab[:3, :3].T + T_ab[:3, 3]


def check_stamps(t: np.ndarray, source: str, field_name: str = "time_stamps") -> None:
    """Raise ``DataError`` unless ``t`` is one finite, strictly increasing row of at least one stamp."""
    t = np.asarray(t)
    if t.ndim != 1 or len(t) == 0 or t.dtype.kind not in "fiu":
        raise DataError(source, field_name, f"{t.dtype} of shape {t.shape}", "(K,) numbers with K >= 1")
    if not np.isfinite(t).all():
        at = int(np.argmin(np.isfinite(t)))
        raise DataError(source, f"{field_name}[{at}]", t[at], "a finite time")
    backwards = np.diff(t) <= 0
    if backwards.any():
        at = int(np.argmax(backwards)) + 1
        raise DataError(
            source, f"{field_name}[{at}]", f"{t[at]:.6f} after {t[at - 1]:.6f}", "strictly increasing times"
        )


def check_shape(values: np.ndarray, source: str, field_name: str, shape: tuple[int, ...]) -> None:
    """Raise ``DataError`` unless ``values`` are numbers of the given shape."""
    if values.shape != shape or values.dtype.kind not in "fiu":
        found = f"{values.dtype} of shape {values.shape}"
        raise DataError(source, field_name, found, f"numbers of shape {shape}")


def check_rows(values: np.ndarray, source: str, field_name: str, shape: tuple[int, ...]) -> None:
    """Raise ``DataError`` unless ``values`` are finite numbers of the given shape."""
    values = np.asarray(values)
    check_shape(values, source, field_name, shape)
    if not np.isfinite(values).all():
        at = tuple(int(i) for i in np.argwhere(~np.isfinite(values))[0])
        raise DataError(source, f"{field_name}{list(at)}", values[at], "a finite number")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses over time: ``t (K,)`` in seconds, strictly increasing, and ``poses (K, 3)``.

    >>> path = Trajectory(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    >>> path.at(0.5).tolist()
    [1.0, 0.0, 0.0]
    """

    t: np.ndarray
    poses: np.ndarray

    def __post_init__(self):
        t, poses = np.asarray(self.t, dtype=float), np.asarray(self.poses, dtype=float)
        check_stamps(t, "Trajectory", "t")
        check_rows(poses, "Trajectory", "poses", (len(t), 3))
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "poses", np.column_stack([poses[:, :2], wrap_angle(poses[:, 2])]))

    def __len__(self) -> int:
        return len(self.t)

    def covers(self, t) -> np.ndarray:
        """Which of the times ``t`` lie within the trajectory's own time (bool, same shape)."""
        t = np.asarray(t, dtype=float)
        return (t >= self.t[0]) & (t <= self.t[-1])

    def at(self, t) -> np.ndarray:
        """Pose at time ``t`` (scalar: ``(3,)``; array ``(M,)``: ``(M, 3)``), interpolated, heading on the circle.

        Between two poses that turn by more than ``ARC`` the way is an arc, as wheels of constant speed drive it.
        Raises ``DataError`` for a time outside the trajectory: a pose out there would be a guess.
        """
        times = np.asarray(t, dtype=float)
        if not self.covers(times).all():
            worst = times[~self.covers(times)].ravel()[0] if times.ndim else float(times)
            raise DataError(
                "Trajectory.at", "t", f"{worst:.6f} s", f"a time in [{self.t[0]:.6f}, {self.t[-1]:.6f}] s"
            )
        i = np.searchsorted(self.t, times, side="right") - 1
        j = np.minimum(i + 1, len(self.t) - 1)  # the last pose is read off as it is, like the others
        part = (times - self.t[i]) / np.where(i < j, self.t[j] - self.t[i], 1.0)
        a, b = self.poses[i], self.poses[j]
        dx, dy, turn = np.moveaxis(b - a, -1, 0)
        turn = wrap_angle(turn)
        # A part of an arc is a chord that is shorter, and points back by half of the turn that is still to come.
        bend = np.where(np.abs(turn) > ARC, turn, 0.0)
        length = part * np.sinc(part * bend / (2.0 * np.pi)) / np.sinc(bend / (2.0 * np.pi))
        back = 0.5 * (1.0 - part) * bend
        c, s = np.cos(back), np.sin(back)
        x, y = a[..., 0] + length * (c * dx + s * dy), a[..., 1] + length * (c * dy - s * dx)
        return _side_by_side(x, y, wrap_angle(a[..., 2] + part * turn))
