"""The silhouette term: unions of outlines against NumPy and closed forms, and where its maximum lies."""

import likelihood_scenes as scenes
import numpy as np
from still_clips import by_hand, clip, of_frames, with_block

from tests.oracles import outlines as oracle
from workbench.core.frame_cache import FrameCache
from workbench.datasets.synthetic import Synthetic
from workbench.likelihoods.cues.image_levels import static_background, uncovered_background
from workbench.likelihoods.cues.outlines import OUTWARDS, outline_sums, running_sums
from workbench.likelihoods.cues.silhouette import Silhouette

ROD = scenes.rods(((0.0, 0.0, -0.3), (0.0, 0.0, 0.3), 0.1))


def box(x, y, half_width, half_height, turn=0.0):
    """An upright outline (4, 2), or one that is turned by so much, rad."""
    corners = OUTWARDS[:, ::-1] * [half_width, half_height]
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return corners @ rotation.T + [x, y]


def test_the_kernel_agrees_with_numpy():
    rng = np.random.default_rng(0)
    image = rng.normal(size=(60, 80)).astype(np.float32)
    outlines = np.array(
        [[box(*rng.uniform(-10, 90, 2), *rng.uniform(3, 20, 2), rng.uniform(0, 6)) for _ in range(6)] for _ in range(9)]
    )
    spheres = np.array([False, False, True, False, False, True])
    for k in np.flatnonzero(spheres):
        outlines[:, k] = outlines[:, k].mean(axis=1, keepdims=True) + 9.0 * OUTWARDS
    outlines[3, 1], outlines[4, 2] = 0.0, np.nan  # not seen, and not projected
    for dilation_px in (0.0, 0.4, 3.0):
        found = outline_sums(running_sums(image), outlines.astype(np.float32), spheres, dilation_px)
        expected = oracle.outline_sums(image, outlines.astype(np.float32), spheres, dilation_px)
        np.testing.assert_allclose(found, expected, atol=1e-3)  # of some 1000 pixels, corners to 1e-6 of 100 px


def test_areas_of_boxes_and_discs_and_of_what_they_share():
    ones, no = running_sums(np.ones((100, 120), np.float32)), np.zeros(2, dtype=bool)
    first, second = box(30.0, 40.5, 10.0, 20.0), box(35.0, 50.5, 10.0, 20.0)
    outside = box(200.0, 50.0, 10.0, 10.0)
    pairs = np.array([[first, outside], [first, second], [first, first]], dtype=np.float32)
    # 20 × 40 each, of which 15 × 30 are shared; rows are whole
    np.testing.assert_allclose(outline_sums(ones, pairs, no), [800.0, 2 * 800.0 - 450.0, 800.0], rtol=1e-6)
    np.testing.assert_allclose(outline_sums(ones, pairs[:1], no, 1.0), [22.0 * 42.0], rtol=1e-6)
    disc = np.array([[box(60.0, 50.0, 20.0, 20.0)]], dtype=np.float32)
    radius = 20.0 * np.sqrt(2.0) + 0.5
    found = outline_sums(ones, disc, np.ones(1, dtype=bool), 0.5)
    np.testing.assert_allclose(found, np.pi * radius**2, rtol=2e-3)  # rows 1 px high


def test_a_rod_gets_the_mean_ratio_of_what_it_covers():
    """k r(80) where all it covers changed, k r(0) on the background, and the even mixture where half of it did."""
    empty = scenes.flat(100)
    still, frames = clip(empty, empty, empty, with_block(empty, 180, slice(None), slice(0, 160)))
    likelihood = scenes.after_first_frame(
        Silhouette(ROD, still, effective_pixels=2.0, dilation_px=0.0), frames[0], scenes.root()[0]
    )
    poses = np.concatenate([scenes.root((0.0, y, 0.0)) for y in (0.8, -0.8, 0.0)])
    found = scenes.log_prob(likelihood, frames[2], frames[3], poses, poses)
    rows = 1 / 40  # of the rod's 46, of which it may cover one more or less than at first
    seen = sorted(found)  # whichever side the camera calls left
    np.testing.assert_allclose(seen[0], 2.0 * by_hand(0.0), rtol=rows)
    np.testing.assert_allclose(seen[2], 2.0 * by_hand(80.0), rtol=rows)
    # the middle column of pixels is 1 of some 30
    np.testing.assert_allclose(found[2], by_hand(0.0) + by_hand(80.0), atol=2.0 * by_hand(80.0) / 25)


def test_how_far_away_a_person_is_is_told_without_bias():
    """The summed ratio of a walk's true poses, moved along the line of sight, is highest within 1 cm of the truth."""
    dataset = Synthetic(n_frames=24, rate_hz=8.0, perturb=False)  # so that any bias is the likelihood's own
    frames, away = list(dataset.frames()), np.linspace(-0.1, 0.1, 41)
    likelihood, total = Silhouette(dataset.body, of_frames(frames)), np.zeros(41)
    camera = frames[0].views[0].camera
    for frame in frames:
        pose = frame.truth.pose
        moved = np.repeat(pose[None], 41, axis=0)
        sight = pose[:3] - camera.position
        moved[:, :3] += away[:, None] * sight / np.linalg.norm(sight)
        likelihood = likelihood.prepare(frame, frame).update(pose)
        total += scenes.log_prob(likelihood, frame, frame, moved, moved)
    assert abs(away[np.argmax(total)]) <= 0.01  # dilation_px is right to a tenth of a pixel: 4 mm at 4 m
    assert total.max() - total[[10, 30]].max() > len(frames) * 0.5  # and 5 cm off costs


def test_without_a_first_frame_it_says_nothing_and_says_so():
    still, frames = clip(*[scenes.flat(100)] * 3)
    frame_likelihood = Silhouette(ROD, still).prepare(frames[0], frames[1])
    assert frame_likelihood.evaluate(scenes.root(), scenes.root()).log_prob == 0.0
    assert "the person's area in camera front is not known yet" in frame_likelihood.notes[0]
    assert Silhouette(ROD, still).prepare(None, frames[0]).notes == ()


def people(*centres, size=(60, 80)):
    """Images (60, 80, 1) of a block 10 px wide about columns `centres` before a pattern, and where it is in each."""
    rng = np.random.default_rng(2)
    wall = rng.uniform(60.0, 120.0, (*size, 1)).astype(np.float32)
    images, places = [], []
    for centre in centres:
        place = np.zeros(size, dtype=bool)
        place[20:50, centre - 5 : centre + 5] = True
        noisy = np.where(place[..., None], 200.0, wall) + rng.normal(0.0, 1.0, (*size, 1))
        images.append(noisy.astype(np.float32))
        places.append(place)
    return wall, images, places


def test_what_is_behind_somebody_who_moves_on_and_stays_there_is_told_by_the_first_frame():
    wall, images, places = people(20, *[60] * 19)
    found = uncovered_background(images, places[0], places[0])
    assert np.abs(found.background.median - wall)[~places[0]].max() < 5.0  # of noise 1, one image
    assert np.abs(found.background.median - wall)[places[0]].max() < 3.0
    assert not found.person.any()
    assert not found.unknown.any()
    median = static_background(images).median
    assert np.abs(median - 200.0)[places[1]].max() < 3.0  # which has the person for the wall


def test_somebody_who_never_moves_is_the_person_and_what_never_changes_beside_them_the_wall():
    _, images, places = people(*[40] * 20)
    near = np.zeros_like(places[0])
    near[17:53, 32:48] = True
    found = uncovered_background(images, places[0], near)
    assert np.array_equal(found.person, places[0])
    assert not found.unknown.any()


def test_where_somebody_sways_nothing_is_known_of_what_is_behind():
    rng = np.random.default_rng(3)
    _, images, places = people(*[40] * 20)
    for image in images:
        image[places[0]] = rng.uniform(0.0, 255.0, (places[0].sum(), 1))
    found = uncovered_background(images, places[0], places[0])
    assert (found.unknown & places[0]).sum() > 0.95 * places[0].sum()


def test_a_standing_person_is_seen_where_the_plain_term_has_them_for_background():
    person = Synthetic(
        n_frames=12, width=160, height=120, person_px=80.0, focal_px=175.0, moving=["left_arm"], perturb=False, seed=1
    )
    frames, pose = list(person.frames()), person.info.initial_pose
    beside = np.stack([frames[5].truth.pose] * 2)
    beside[1, :3] += 0.1 * person.true_camera.rotation[0]
    told = {}
    for from_first_pose in (False, True):
        term = Silhouette(person.body, FrameCache(person), background_from_first_pose=from_first_pose)
        frame_likelihood = term.prepare(None, frames[0]).update(pose).prepare(frames[0], frames[5])
        told[from_first_pose] = frame_likelihood.evaluate(beside, beside).log_prob
    assert told[True][0] > told[True][1] + 5.0
    assert told[True][0] > 0.0 > told[False][0]
