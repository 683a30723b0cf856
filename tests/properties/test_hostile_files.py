"""Whatever is done to a file or to what a run recorded of itself, its reader reads it or says one sentence, soon."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hostile import HANG_S, KINDS, OWN_PROCESS, main, mutated, prepare, read_properties, some_properties
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.errors import LONGEST, InputError
from workbench.recording.read.properties import check_settings, checked

SCRIPT = Path(sys.modules[main.__module__].__file__)
EVERY = 10_000
CASES = {**dict.fromkeys(OWN_PROCESS, 250), "recordings": 50}
"""Of those that take long each; $WORKBENCH_CASES is how many there are to be of every kind instead."""

MOST_MB = 1000

seeds = st.integers(0, 2**32 - 1)


def told(read, *arguments):
    """The sentence that refuses what is read; empty where it is read."""
    try:
        read(*arguments)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in OWN_PROCESS])
def test_a_changed_file_is_read_or_refused_in_a_sentence(kind, tmp_path):
    path, content = prepare(kind, tmp_path)
    KINDS[kind][2](path)

    @given(seeds)
    @settings(max_examples=20)
    def keeps(seed):
        path.write_bytes(mutated(content, np.random.default_rng(seed)))
        assert len(told(KINDS[kind][2], path).encode()) <= 4 * LONGEST

    keeps()


@pytest.mark.parametrize("kind", OWN_PROCESS)
def test_a_sound_file_is_read(kind, tmp_path):
    if kind == "c3d":
        pytest.importorskip("ezc3d")
    path, _ = prepare(kind, tmp_path)
    assert KINDS[kind][2](path)


@given(seeds)
@settings(max_examples=50)
def test_changed_properties_are_sound_or_refused_in_a_sentence(seed):
    assert len(told(checked, Path("a.rrd"), some_properties(np.random.default_rng(seed)))) <= LONGEST


plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary() | st.dates()
nested = st.recursive(plain, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3))


@given(st.dictionaries(st.sampled_from(["seed", "prior", "paths", "check", "note"]), nested, max_size=4))
@settings(max_examples=50)
def test_any_settings_are_plain_or_refused(found):
    if not (sentence := told(check_settings, Path("a.rrd"), found)):
        json.dumps(found).encode()
    assert len(sentence) <= LONGEST


def test_a_hostile_run_hides_no_sound_one(tmp_path):
    for seed in range(5):
        sentence = told(read_properties, tmp_path, np.random.default_rng(seed))
        assert "a.rrd" in sentence or not sentence


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*KINDS, "properties", "recordings"])
def test_ten_thousand_of_a_kind(kind, tmp_path):
    """Nothing but sentences, soon, within bounds of memory; fewer of those that take long each."""
    if kind == "c3d":
        pytest.importorskip("ezc3d")
    script = SCRIPT.with_name("hostile_recordings.py") if kind == "recordings" else SCRIPT
    command = [sys.executable, str(script), kind, os.environ.get("WORKBENCH_CASES", str(CASES.get(kind, EVERY))), "7"]
    done = subprocess.run(
        [*command, str(tmp_path)], capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2]
    )
    assert done.returncode == 0, done.stderr[-2000:]
    told = json.loads(done.stdout.splitlines()[-1])
    assert (told["hangs"], told["tracebacks"], told["long"], told["first"]) == (0, 0, 0, []), told
    assert told["slowest_s"] < HANG_S
    assert told["most_mb"] < MOST_MB
    assert told["refused"] > 0
