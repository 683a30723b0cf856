"""The protocol of held-out subjects: its splits, and the view and occlusion of every run."""

from collections import Counter

import pytest
from compositions import composed
from omegaconf import OmegaConf

from workbench.experiment.config.resolvers import RESOLVERS
from workbench.utils.errors import InputError

activity_of, clips_of, first_frame, split_of = (
    RESOLVERS[name] for name in ("activity_of", "clips_of", "first_frame", "split_of")
)
TEST = {
    "02_01", "dataset-1_walk_old_001", "dataset-2_walk_elderly_002", "03_04", "32_02", "dataset-1_run_old_001",
    "dataset-2_run_elderly_026", "dataset-1_byebye_active_001", "dataset-1_byebye_masculinity_001",
    "dataset-1_bye_musical_001", "dataset-1_respond_normal_001", "dataset-1_dance-short_normal_001",
    "dataset-1_bow_normal_001", "dataset-1_bow_tired_001", "02_05", "dataset-1_kick_normal_001",
}  # fmt: skip
"""No parameter may be tuned on these, so a clip must never change its split."""


@pytest.fixture(scope="module")
def listed():
    return OmegaConf.to_container(composed("experiment=held_out_subjects").clips.held_out)


def run(clip, seed=0):
    return composed("experiment=held_out_subjects", f"dataset.motion='{clip}'", f"seed={seed}")


def test_the_split_is_as_it_was_first_made(listed):
    assert set(clips_of(listed, "test")) == TEST
    assert set(clips_of(listed, "validation")) == set(clips_of(listed)) - TEST
    assert len(clips_of(listed)) == len(set(clips_of(listed))) >= 24


def test_the_split_follows_from_a_clips_name_alone():
    assert (split_of("35_02"), split_of("02_01")) == ("validation", "test")
    with pytest.raises(InputError, match="expected one of test, validation or null, found 'best'"):
        clips_of({}, "best")


def test_every_activity_but_the_kick_that_is_one_clip_is_in_both_splits(listed):
    for activity, clips in listed.items():
        assert {split_of(clip) for clip in clips} == {"validation", "test"}, activity
        assert all(activity_of(listed, clip) == activity for clip in clips)
        assert all(first_frame(listed, clip) == frame for clip, frame in clips.items())
    assert (activity_of(listed, "35_02"), first_frame(listed, "35_02")) == (None, 0)


@pytest.mark.slow
def test_what_a_run_shows_is_drawn_for_every_clip_and_seed(listed):
    shown = Counter()
    for clip in clips_of(listed, "test")[::4]:
        for seed in range(3):
            config = run(clip, seed)
            assert config.protocol.split == "test"
            assert config.dataset.seed == seed
            assert (config.protocol.occlusion == "moving board") == config.dataset.occluder
            shown.update([config.dataset.view_azimuth_deg, config.dataset.occluder])
    assert set(shown) == {0.0, 90.0, 180.0, 270.0, True}


def test_the_persons_clips_and_those_in_their_style_are_left_out():
    assert list(run("02_05").prior.exclude) == ["02"]
    assert list(run("dataset-1_bow_old_001").prior.exclude) == ["bandai-old"]


def test_a_sweep_goes_through_one_half_where_it_is_told_to(listed):
    from hydra import compose, initialize_config_module

    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", ["experiment=held_out_subjects", "clips.split=test", "paths.data=D"], True)
    assert config.hydra.sweeper.params["dataset.motion"] == ",".join(f"'{clip}'" for clip in clips_of(listed, "test"))
