"""A camera over a painted floor, from geometry alone: the oracle of the texture tests, free of pfslam.

Everything is a ray that meets a plane. The numbers are those of the report and of its second pinhole camera.
"""

import numpy as np

PITCH, FORWARD, HEIGHT = np.deg2rad(18.0), 0.16766, 0.38001
DEPTH_CAMERA = (585.05108211, 315.83800193, 242.94140713)
TILE = 0.2


def tile_colour(x, y):
    """Tiles of 0.2 m, each of its own colour within 25 m: red counts columns, green rows, blue alternates."""
    ix, iy = np.floor(x / TILE).astype(int), np.floor(y / TILE).astype(int)
    return np.stack([(ix % 125) * 2, (iy % 125) * 2, 250 * ((ix + iy) % 2)], axis=-1).astype(np.uint8)


def camera_axes(theta, pitch):
    """Right, down and forward of the optical frame as world vectors, for a body at yaw theta."""
    forward = np.array([np.cos(pitch) * np.cos(theta), np.cos(pitch) * np.sin(theta), -np.sin(pitch)])
    right = np.array([np.sin(theta), -np.cos(theta), 0.0])
    return right, np.cross(forward, right), forward


def rays(focal, centre_u, centre_v, theta, pitch, shape=(480, 640)):
    v, u = np.indices(shape)
    right, down, forward = camera_axes(theta, pitch)
    return ((u - centre_u) / focal)[..., None] * right + ((v - centre_v) / focal)[..., None] * down + forward


def disparity_image(pose, pitch=PITCH, height=HEIGHT, slope=0.0, floor_height=0.0):
    """uint16 disparity of the floor z = floor_height + slope * (distance ahead); 2047 for no reading."""
    theta = pose[2]
    ray = rays(*DEPTH_CAMERA, theta, pitch)
    ahead = ray[..., 0] * np.cos(theta) + ray[..., 1] * np.sin(theta)
    fall = slope * ahead - ray[..., 2]
    drop = height - floor_height - slope * FORWARD
    depth = np.divide(drop, fall, out=np.full(fall.shape, np.inf), where=fall > 0)
    seen = depth < 12.0
    disparity = np.full(depth.shape, 2047, dtype=np.uint16)
    disparity[seen] = np.rint((3.31 - 1.03 / depth[seen]) / 0.00304)
    return disparity


def colour_image(pose, pitch=PITCH, height=HEIGHT):
    """uint8 image of the tiles, by the colour camera 26 mm to the right of the depth camera; grey sky."""
    x, y, theta = pose
    right, _, _ = camera_axes(theta, pitch)
    focal, baseline = 526.37, 4.5 * 1750.46 * 1.03 / 585.051
    # Eq. 16 with u = f X / Z + c and dd = 1.03 / Z is a pinhole: u_rgb = 526.37 (X - b) / Z + centre.
    centre_u = (526.37 * DEPTH_CAMERA[1] + 19276.0) / 585.051
    centre_v = (526.37 * DEPTH_CAMERA[2] + 16662.0) / 585.051
    ray = rays(focal, centre_u, centre_v, theta, pitch)
    depth_camera = np.array([x + FORWARD * np.cos(theta), y + FORWARD * np.sin(theta), height])
    at = depth_camera + baseline / focal * right
    image = np.full((480, 640, 3), 128, dtype=np.uint8)
    down = ray[..., 2] < -1e-3
    reach = at[2] / -ray[down][:, 2]
    image[down] = tile_colour(at[0] + reach * ray[down][:, 0], at[1] + reach * ray[down][:, 1])
    return image


def nearest_floor(camera):
    """Compute how far ahead of the camera (m) the floor enters the image.

    The lowest row looks down by the pitch plus half the field of view; the floor is at height / tan(angle). A robot
    that turns on the spot sees no floor within this distance plus that of the camera from the turning point.
    """
    angle = camera.pitch + np.arctan((camera.height - 0.5 - camera.centre_v) / camera.focal_v)
    return float(camera.position_b[2] / np.tan(angle))


def depth_step(depth, camera):
    """Compute by how many metres the depth changes for one step of disparity: it grows as depth squared."""
    return np.asarray(depth) ** 2 * abs(camera.disparity_slope) / camera.depth_scale
