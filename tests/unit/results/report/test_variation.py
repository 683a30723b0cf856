"""Which keys of configurations tell runs apart, and how groups are called."""

from workbench.results.report.variation import flat, label, seeds_of_parts, what_varied

WALKING = {"_target_": "workbench.priors.from_motions.walking", "motions": "builtin", "variance": 0.95}
SMOOTH = {"_target_": "workbench.priors.smooth.Smooth", "damping": 0.0}


def settings(prior=WALKING, n=500, experiment="custom", **more):
    return flat({"prior": prior, "inference": {"n_particles": n}, "seed": 0, **more}, experiment)


def test_a_choice_and_a_number_are_what_varied():
    # every key of either prior differs too, but follows the choice
    found = what_varied([settings(prior, n) for prior in (WALKING, SMOOTH) for n in (500, 5000)])
    assert (found.keys, found.following) == (("prior._target_", "inference.n_particles"), ())
    assert label(found.keys, settings(SMOOTH, 500)) == "smooth, n_particles=500"
    assert label(found.keys, settings(WALKING, 5000)) == "walking, n_particles=5000"


def test_a_key_of_one_choice_only_is_left_out_of_the_others_label():
    tuned = [WALKING, {**WALKING, "variance": 0.8}, SMOOTH]
    found = what_varied([settings(prior) for prior in tuned])
    assert found.keys == ("prior._target_", "prior.variance")
    assert [label(found.keys, settings(prior)) for prior in tuned] == [
        "walking, variance=0.95", "walking, variance=0.8", "smooth",
    ]  # fmt: skip


def test_what_cannot_change_the_numbers_is_no_difference():
    def places(name):
        paths = {"data": f"/{name}", "cache": f"/{name}"}
        return {"paths": paths, "threads": len(name), "recorder": {"live": name == "a"}, "dataset": paths, "seed": name}

    assert what_varied([settings(**places("a")), settings(**places("bb"))]).keys == ()
    assert flat({"recorder.live": True, "seed": 3, "a.b": 1}, "x") == {"experiment": "x", "a.b": 1}  # of a table


def test_a_parts_seed_repeats_only_where_it_is_the_runs_own():
    own = [settings(dataset={"seed": seed}, likelihood={"seed": 0}) for seed in (0, 1)]
    assert seeds_of_parts(own, [0, 1]) == {"dataset.seed"}
    assert seeds_of_parts(own, [0, 2]) == set()


def test_what_an_experiment_or_a_motion_brings_with_it_follows():
    found = what_varied([settings(n=n, experiment=name) for name, n in (("walk_straight", 500), ("walk_circle", 900))])
    assert (found.keys, found.following) == (("experiment",), ("inference.n_particles",))
    motions = [
        settings({**WALKING, "leave_out": [motion]}, dataset={"motion": motion, "view_deg": view})
        for motion, view in (("35_02", 30.0), ("07_01", 60.0), ("16_15", 30.0))
    ]
    found = what_varied(motions)
    assert (found.keys, found.following) == (("dataset.motion",), ("prior.leave_out", "dataset.view_deg"))


def test_a_number_brings_no_other_with_it_and_a_key_that_crosses_a_choice_is_its_own():
    rows = [settings(n=n, dataset={"noise": noise}) for n, noise in ((500, 1.0), (5000, 2.0))]
    assert what_varied(rows).keys == ("inference.n_particles", "dataset.noise")
    rows = [settings(prior, dataset={"view_deg": v}) for prior, v in ((WALKING, 0), (WALKING, 90), (SMOOTH, 0))]
    assert what_varied(rows).keys == ("prior._target_", "dataset.view_deg")
