"""Cut snapshots keep what they show, at one size."""

import numpy as np

from renderer.figures.figure6.snapshots import crop_alike


def test_crop_keeps_all_content_at_one_size() -> None:
    pictures = np.full((3, 60, 80, 3), 200, dtype=np.uint8)
    pictures += np.arange(60, dtype=np.uint8)[None, :, None, None] // 2  # a vertical gradient
    for i, picture in enumerate(pictures):
        picture[20:50, 10 + 20 * i : 18 + 20 * i] = 30  # walks to the right
    other = pictures.copy()
    other[1, 15:20, 34:36] = 60  # one row's raised hand

    cropped = crop_alike({"a": pictures, "b": other})

    shapes = {stack.shape for stack in cropped.values()}
    assert len(shapes) == 1
    _, height, width, _ = shapes.pop()
    assert 35 <= height <= 42 and 8 <= width <= 14
    for name, original in (("a", pictures), ("b", other)):
        for before, after in zip(original, cropped[name], strict=True):
            assert (after < 100).sum() == (before < 100).sum()
    background_a, background_b = (cropped[name][1] >= 100 for name in "ab")
    assert (background_a != background_b).any(-1).sum() == 10  # the same place in both rows


def test_crop_keeps_empty_and_full_pictures_whole() -> None:
    empty = {"a": np.full((2, 30, 40, 3), 255, dtype=np.uint8)}
    np.testing.assert_array_equal(crop_alike(empty)["a"], empty["a"])

    rng = np.random.default_rng(0)
    full = {"a": rng.integers(0, 255, (2, 30, 40, 3), dtype=np.uint8)}
    np.testing.assert_array_equal(crop_alike(full)["a"], full["a"])


def test_crop_keeps_an_arm_that_leaves_the_picture() -> None:
    pictures = np.full((5, 30, 40, 3), 255, dtype=np.uint8)
    pictures[:, 5:25, 18:22] = 50
    pictures[2, 10:12, :18] = 50

    cropped = crop_alike({"a": pictures})["a"]

    assert (cropped[2] == 50).sum() == (pictures[2] == 50).sum()
