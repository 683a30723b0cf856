"""Cuts and repeated images of small synthetic videos; every threshold from both sides."""

import cv2
import numpy as np
import pytest

from workbench.cameras.image_changes import ImageChanges, frozen

SIZE = 160, 240
RATE_HZ = 30.0
N = 40
"""Images of a part."""


def texture(seed, size=SIZE, block=5):
    """Return a scene of grey blocks, of standard deviation 1."""
    rng = np.random.default_rng(seed)
    coarse = rng.normal(size=(-(-size[0] // block), -(-size[1] // block)))
    return np.kron(coarse, np.ones((block, block)))[: size[0], : size[1]]


def shown(scenes, contrast=30.0, level=120.0):
    """Return RGB images of scenes."""
    images = (np.clip(level + contrast * scene, 0, 255).round().astype(np.uint8) for scene in scenes)
    return [np.repeat(image[..., None], 3, axis=2) for image in images]


def changes(images):
    found = ImageChanges()
    for image in images:
        found.add(image)
    return found


def cuts(scenes, rate_hz=RATE_HZ, **options):
    return changes(shown(scenes, **options)).cuts(rate_hz).tolist()


def mixed(one, other, share):
    """Return a scene that correlates with one by `share`."""
    return share * one + np.sqrt(1.0 - share**2) * other


def details(scene):
    """Return a scene without its means over 9 × 9 blocks, whose blocks are the pixels of its thumbnail."""
    thumbnail = scene[::5, ::5]
    return thumbnail - cv2.blur(thumbnail, (9, 9))


def unrelated(scene, other):
    """Return the other scene without what correlates with the details of the first one."""
    of_scene = details(scene)
    return other - (of_scene * details(other)).sum() / np.square(of_scene).sum() * scene


A, B, C = (texture(seed) for seed in range(3))


def test_every_part_of_an_edited_film_is_found():
    assert cuts([A] * N + [B] * N + [C] * N) == [N, 2 * N]
    assert cuts([A] * N) == []
    assert changes([]).cuts(RATE_HZ).tolist() == []


@pytest.mark.parametrize(("share", "is_cut"), [(0.27, True), (0.33, False)])
def test_images_after_a_cut_correlate_with_those_before_by_less_than_0_3(share, is_cut):
    assert cuts([A] * N + [mixed(A, unrelated(A, B), share)] * N) == ([N] if is_cut else [])


@pytest.mark.parametrize(("share", "is_cut"), [(0.47, False), (0.53, True)])
def test_most_neighbours_of_a_cut_correlate_by_more_than_0_5(share, is_cut):
    scenes = [A]
    for k in range(1, 2 * N):
        scenes.append(texture(k + 10) if k == N else mixed(scenes[-1], texture(k + 10), share))
    assert (N in cuts(scenes)) == is_cut


@pytest.mark.parametrize(
    ("n", "rate_hz", "is_cut"), [(14, 30.0, False), (15, 30.0, True), (2, 4.0, False), (3, 4.0, True)]
)
def test_what_lasts_for_less_than_half_a_second_or_three_images_is_no_part(n, rate_hz, is_cut):
    assert cuts([A] * N + [B] * n + [A] * N, rate_hz) == ([N, N + n] if is_cut else [])


@pytest.mark.parametrize(("contrast", "is_cut"), [(0.9, False), (1.1, True)])
def test_uniform_images_are_not_compared(contrast, is_cut):
    assert cuts([A] * N + [B] * N, contrast=contrast) == ([N] if is_cut else [])


@pytest.mark.parametrize(
    ("seconds", "scene", "is_cut"), [(0.1, A, False), (2.0, A, False), (0.1, B, True), (2.0, B, True)]
)
def test_a_flash_and_a_black_image_are_no_cuts_unless_another_scene_follows(seconds, scene, is_cut):
    for level in (0.0, 255.0):
        between = [np.full((*SIZE, 3), level, np.uint8)] * round(seconds * RATE_HZ)
        found = changes([*shown([A] * N), *between, *shown([scene] * N)]).cuts(RATE_HZ)
        assert found.tolist() == ([N + len(between)] if is_cut else [])


def test_a_fade_through_black_is_a_cut():
    fade = np.linspace(1.0, 0.0, 15)
    images = [*shown([A] * N), *(shown([A], 30.0 * f, 120.0 * f)[0] for f in fade)]
    images += [*(shown([B], 30.0 * f, 120.0 * f)[0] for f in fade[::-1]), *shown([B] * N)]
    found = changes(images).cuts(RATE_HZ)
    assert len(found) == 1
    assert N + 10 < found[0] < N + 20


def test_a_change_of_exposure_is_no_cut():
    assert changes([*shown([A] * N), *shown([A] * N, 60.0, 160.0), *shown([A] * N, 12.0, 40.0)]).cuts(RATE_HZ).size == 0


def test_a_person_who_crosses_the_whole_image_is_no_cut():
    """In front of the lens: wider than the image, which is covered within one image and for 0.3 s."""
    person = texture(5, (SIZE[0], 9 * SIZE[1]))
    hidden = [person[:, k * SIZE[1] // 2 :][:, : SIZE[1]] for k in range(9)]
    assert cuts([A] * N + hidden + [A] * N) == []
    slowly = np.hstack([A, person[:, : SIZE[1]], A])
    assert cuts([A] * N + [slowly[:, k : k + SIZE[1]] for k in range(0, 2 * SIZE[1], 12)] + [A] * N) == []


@pytest.mark.parametrize("step", [1, 5, 20, 60, 200])
def test_a_fast_pan_is_no_cut(step):
    wide = texture(6, (SIZE[0], SIZE[1] + N * step))
    pan = [wide[:, k * step : k * step + SIZE[1]] for k in range(N)]
    assert cuts([pan[0]] * N + pan + [pan[-1]] * N) == []


@pytest.mark.parametrize(("shift", "is_cut"), [(0.4, False), (1.0, True)])
def test_a_jerk_after_which_corners_are_found_again_is_no_cut(shift, is_cut):
    wide = cv2.resize(texture(7, (SIZE[0], 2 * SIZE[1])), None, fx=2.0, fy=2.0, interpolation=cv2.INTER_NEAREST)
    width = 2 * SIZE[1]
    moved = round(shift * width)
    assert cuts([wide[:, :width]] * N + [wide[:, moved : moved + width]] * N) == ([N] if is_cut else [])


@pytest.mark.parametrize(("share", "is_cut"), [(0.1, True), (0.25, False)])
def test_a_logo_is_less_than_an_eighth_of_the_corners(share, is_cut):
    images = shown([texture(8, (480, 480), 12)] * N + [texture(9, (480, 480), 12)] * N)
    logo = round(480 * np.sqrt(share))
    for image in images:
        image[60 : 60 + logo, 60 : 60 + logo] = images[0][60 : 60 + logo, 60 : 60 + logo]
    assert changes(images).cuts(RATE_HZ).tolist() == ([N] if is_cut else [])


def moving(n, step=2):
    wide = texture(10, (SIZE[0], SIZE[1] + n * step))
    return shown([wide[:, k * step : k * step + SIZE[1]] for k in range(n)])


@pytest.mark.parametrize(("n", "is_frozen"), [(6, False), (8, True)])
def test_a_video_that_repeats_its_image_for_a_quarter_of_a_second_is_frozen(n, is_frozen):
    images = moving(N)
    repeated = changes([*images[:20], *[images[19]] * n, *images[20:]]).repeated()
    assert np.flatnonzero(repeated).tolist() == list(range(20, 20 + n))
    assert frozen(repeated, RATE_HZ).sum() == (n if is_frozen else 0)


@pytest.mark.parametrize(("n", "is_frozen"), [(2, False), (3, True)])
def test_at_a_low_rate_three_repeated_images_are_frozen(n, is_frozen):
    assert frozen(np.array([False] * 5 + [True] * n + [False] * 5), 5.0).any() == is_frozen


def test_images_that_are_each_shown_twice_are_repeated_but_not_frozen():
    repeated = changes([image for image in moving(N) for _ in range(2)]).repeated()
    assert repeated.mean() == 0.5
    assert not frozen(repeated, RATE_HZ).any()


def test_a_still_video_is_not_frozen():
    assert not changes(moving(1) * N).repeated().any()


@pytest.mark.parametrize(("sixteenths", "is_repeated"), [(1, True), (3, False)])
def test_less_than_a_tenth_of_a_level_is_a_repeated_image(sixteenths, is_repeated):
    """The mean difference of images in which a part of the pixels is one level lighter."""
    images = moving(N)
    other = images[-1].copy()
    other[:, : SIZE[1] * sixteenths // 16] += 1
    assert changes([*images, other]).repeated()[-1] == is_repeated


@pytest.mark.parametrize(("noise", "is_repeated"), [(1, False), (4, True)])
def test_repeated_images_differ_by_less_than_a_twentieth_of_moving_ones(noise, is_repeated):
    """Moving images differ by about 0.5 and 1.6 levels, the last by 1/16 of a level."""
    still = shown([A])[0]
    rng = np.random.default_rng(0)
    images = [still + rng.integers(0, noise + 1, (*SIZE, 1), dtype=np.uint8) for _ in range(N)]
    other = images[-1].copy()
    other[:, : SIZE[1] // 16] += 1
    assert changes([*images, other]).repeated()[-1] == is_repeated


@pytest.mark.parametrize(("n", "lighter", "is_repeated"), [(4, 0, True), (5, 0, False), (1, 2, True), (1, 3, False)])
def test_a_picture_that_is_drawn_anew_is_a_repeated_image(n, lighter, is_repeated):
    """Between two stretches, by n images with another noise, after which the picture may be lighter.

    The first image after the noise differs from it, and is part of what is drawn anew.
    """
    images, rng = moving(N), np.random.default_rng(0)
    last = images[-1]
    noisy = [np.clip(last + rng.normal(scale=3.0, size=last.shape), 0, 255).astype(np.uint8) for _ in range(n)]
    repeated = changes([*images, *[last] * 5, *noisy, *[last + np.uint8(lighter)] * 5]).repeated()
    assert repeated[N:].tolist() == [True] * 5 + [is_repeated] * (n + 1) + [True] * 4
