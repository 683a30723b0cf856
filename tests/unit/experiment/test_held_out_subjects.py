"""The protocol of held-out subjects: its splits, and the view and occlusion of each run."""

from collections import Counter

import pytest
from compositions import composed
from omegaconf import OmegaConf

from workbench.cli.hydra_quoting import quoted
from workbench.experiment.config.resolvers import RESOLVERS
from workbench.motion.formats.names import performer, style
from workbench.utils.errors import InputError

activity_of, clips_of, first_frame, split_of = (
    RESOLVERS[name] for name in ("activity_of", "clips_of", "first_frame", "split_of")
)
TEST_PEOPLE = {"02", "05", "06", "07", "08", "16", "bandai-2"}
"""People on whom no parameter may be tuned."""


@pytest.fixture(scope="module")
def lists():
    return OmegaConf.to_container(composed("experiment=held_out_subjects").clips.held_out)


def run(clip, seed=0):
    return composed("experiment=held_out_subjects", f"dataset.motion='{clip}'", f"seed={seed}")


def people(clips):
    return {performer(clip) for clip in clips}


def flat(entry):
    return [clip for item in entry for clip in flat(item)] if isinstance(entry, list) else [entry]


def test_validation_and_test_clips_share_no_performer_and_no_style():
    clips = OmegaConf.to_container(composed("experiment=held_out_subjects").clips)
    tested = [clip for name, entry in clips.items() if name.startswith("test") for clip in flat(entry)]
    tested += clips_of(clips["held_out"], "test")
    tuned = [*clips["validation"], *clips_of(clips["held_out"], "validation")]
    assert people(tested) == TEST_PEOPLE
    assert not people(tested) & people(tuned)
    assert not {style(clip) for clip in tested} & {style(clip) for clip in tuned} - {None}
    assert len(tested + tuned) > len(set(tested + tuned)) >= 30  # some clips are in several lists


def test_split_activity_and_first_frame_are_those_listed(lists):
    assert clips_of(lists) == clips_of(lists, "validation") + clips_of(lists, "test")
    for split, activities in lists.items():
        for activity, clips in activities.items():
            for clip, frame in clips.items():
                values = split_of(lists, clip), activity_of(lists, clip), first_frame(lists, f"folder/{clip}.bvh")
                assert values == (split, activity, frame)
    assert (split_of(lists, "35_02"), activity_of(lists, "35_02"), first_frame(lists, "35_02")) == (None, None, 0)
    with pytest.raises(InputError, match="expected one of validation, test or null, found 'best'"):
        clips_of(lists, "best")


@pytest.mark.slow
def test_view_and_occlusion_are_drawn_for_every_clip_and_seed(lists):
    drawn = Counter()
    for clip in clips_of(lists, "test")[::5]:
        for seed in range(3):
            config = run(clip, seed)
            assert config.protocol.split == "test"
            assert config.dataset.seed == seed
            assert (config.protocol.occlusion == "moving board") == config.dataset.occluder
            drawn.update([config.dataset.view_azimuth_deg, config.dataset.occluder])
    assert set(drawn) == {0.0, 90.0, 180.0, 270.0, True}


@pytest.mark.parametrize(
    ("value", "excluded"), [("[${dataset.motion}]", ["02_05"]), ("${performers:${dataset.motion}}", ["02"])]
)
def test_the_excluded_people_may_depend_on_the_clip(value, excluded):
    config = composed("experiment=held_out_subjects", "dataset.motion='02_05'", quoted(f"training.exclude={value}"))
    assert list(config.prior.exclude) == excluded


def test_a_sweep_runs_the_clips_of_the_chosen_split(lists):
    from hydra import compose, initialize_config_module

    with initialize_config_module("workbench.conf", version_base="1.3"):
        config = compose("config", ["experiment=held_out_subjects", "clips.split=test", "paths.data=D"], True)
    assert config.hydra.sweeper.params["dataset.motion"] == ",".join(f"'{clip}'" for clip in clips_of(lists, "test"))
