"""The book's first picture: the map it redraws is the filter's own, and the animation keeps its frames."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from box_recording import box_recording
from hero import encode_animation, growing_map, make_scene

from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam.texture import FloorTexture


@pytest.fixture(scope="module")
def scene():
    recording = box_recording(seconds=4.0, images=0)
    result = run_slam(recording, replace(SlamConfig.refined(), particles=5, every=1))
    shape = result.grid.spec.shape
    blank = FloorTexture(result.grid.spec, np.zeros((*shape, 3), np.uint8), np.zeros(shape, bool))
    return make_scene(recording, result, blank)


def test_the_map_that_grows_ends_as_the_map_of_the_run(scene):
    last = len(scene.result.infos) - 1
    maps = dict(growing_map(scene, [0, last]))
    grid = scene.result.grid
    offset = np.rint((np.array(scene.spec.origin) - grid.spec.origin) / grid.spec.resolution).astype(int)
    window = tuple(slice(o, o + n) for o, n in zip(offset[::-1], scene.spec.shape, strict=True))
    np.testing.assert_array_equal(maps[last], grid.log_odds[window])
    assert np.count_nonzero(maps[0]) < np.count_nonzero(maps[last])


def test_animation_keeps_frames_times_and_colours():
    red, blue = np.zeros((32, 48, 3), np.uint8), np.zeros((32, 48, 3), np.uint8)
    red[..., 0], blue[..., 2] = 250, 250
    done, animation = cv2.imdecodeanimation(
        np.frombuffer(encode_animation([red, blue], [300, 100]), np.uint8)
    )
    assert done
    assert list(animation.durations) == [300, 100]
    assert animation.loop_count == 0
    first, second = (frame[16, 24, :3].astype(int) for frame in animation.frames)
    assert first[2] > 200 > 60 > first[0]  # decoded as blue, green, red
    assert second[0] > 200 > 60 > second[2]
