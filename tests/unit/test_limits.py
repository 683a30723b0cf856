"""Bounds on what is read: bombs, pipes and nonsense are one short sentence, before anything of their size is made."""

import json
import os
import time

import numpy as np
import pytest
from bandai_files import write_bandai_like
from hostile import BVH, TRC

from workbench.body.camera import load_cameras
from workbench.body.shape import from_height
from workbench.datasets.files.marks import read_marks
from workbench.datasets.files.point_formats import read_npz
from workbench.datasets.point_files import PointFiles
from workbench.errors import LONGEST, InputError
from workbench.limits import (
    DEEPEST,
    LARGEST,
    LARGEST_PX,
    LONGEST_LIMB_M,
    MOST_COUNT,
    MOST_JOINTS,
    MOST_NUMBERS,
    MOST_REFERENCES,
    bounded_memory,
    check_file,
    check_products,
    check_rate,
    check_sizes,
    parse_json,
    parse_toml,
    parse_yaml,
)  # fmt: skip
from workbench.mocap import sources
from workbench.mocap.bvh import read_bvh
from workbench.mocap.generated.gait import subjects, walker
from workbench.mocap.marker_files import read_markers
from workbench.mocap.openpose import read_openpose

SOON_S = 5.0


@pytest.fixture
def soon():
    """Within seconds of the processor: what else the machine does counts nothing."""
    began = time.process_time()
    yield
    assert time.process_time() - began < SOON_S


def refusal(read, *arguments, **keys):
    with pytest.raises(InputError) as caught:
        read(*arguments, **keys)
    assert len(str(caught.value)) <= LONGEST
    return str(caught.value)


def written(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_a_sentence_is_short_and_text_whatever_it_quotes():
    said = str(InputError(f"a.toml: expected b, found {'x' * 3_000_000!r}"))
    assert len(said) == LONGEST
    assert said.startswith("a.toml: expected b, found 'xxx")
    assert " … " in said
    assert str(InputError("short")) == "short"
    str(InputError("a\ud800")).encode()


def test_twenty_thousand_joints(tmp_path, soon):
    joints = "".join(f"JOINT j{k}\n{{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Zrotation Yrotation\n" for k in range(20_000))
    content = BVH.replace("  JOINT arm", f"{joints}  JOINT arm")
    assert f"at most {MOST_JOINTS} joints" in refusal(read_bvh, written(tmp_path / "a.bvh", content))


def test_markers_whose_blanks_are_left_out(tmp_path, soon):
    lines = TRC.split("\n")
    many = "\t".join(f"m{k}\t\t" for k in range(MOST_JOINTS + 1))
    lines[3] = f"Frame#\tTime\t{many}"
    assert "markers" in refusal(read_markers, written(tmp_path / "a.trc", "\n".join(lines)))
    lines[3] = "Frame#\tTime\t" + "\t".join(f"m{k}\t\t" for k in range(MOST_JOINTS))
    content = "\n".join([*lines, *["1\t0"] * (MOST_NUMBERS // 3 // MOST_JOINTS + 1)])
    assert "coordinates" in refusal(read_markers, written(tmp_path / "b.trc", content))


@pytest.mark.parametrize(
    "content",
    [
        ".".join("a" * 200_000) + " = 1", "[" + ".".join("a" * 200_000) + "]", "a = " + "[" * 5000,
        "a = 1" + "0" * 5000,
        "\n".join(f"a{k}.b = 1" for k in range(80_000)), "x" * 900_000, 'a."b".' * 100 + "c = 1",
        "a = " + "{b = " * 3000 + "}" * 3000,
    ],
)  # fmt: skip
def test_toml(tmp_path, soon, content):
    refusal(load_cameras, written(tmp_path / "a.toml", content))


def test_a_folder_and_a_pipe_are_no_files(tmp_path, soon):
    (tmp_path / "a.toml").mkdir()
    assert "expected a file, found a folder" in refusal(load_cameras, tmp_path / "a.toml")
    for name in ("b.toml", "b.csv", "b_1.json", "b.bvh", "b.trc"):
        os.mkfifo(tmp_path / name)
    refusal(load_cameras, tmp_path / "b.toml")
    refusal(read_marks, tmp_path / "b.csv")
    refusal(read_openpose, tmp_path)
    refusal(read_bvh, tmp_path / "b.bvh")
    refusal(read_markers, tmp_path / "b.trc")
    refusal(check_file, tmp_path / "no")
    refusal(check_file, tmp_path / "\x00")


@pytest.mark.parametrize("text", ["[" * 100_000, "1" * 5000, '{"a":' * 100_000, "NaN,", "\x00"])
def test_json_and_yaml_and_toml_that_go_on(text, soon):
    refusal(parse_json, "a.json", text)
    refusal(parse_toml, "a.toml", text)
    if text[0] in "[{\x00":
        refusal(parse_yaml, "a.yaml", text)


def test_yaml_of_references_and_of_many_levels(soon):
    bomb = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"{chr(98 + k)}: &{chr(98 + k)} [{', '.join([f'*{chr(97 + k)}'] * 9)}]\n" for k in range(9)
    )
    assert "without references" in refusal(parse_yaml, "a.yaml", bomb)
    assert parse_yaml("a.yaml", "[" * DEEPEST + "]" * DEEPEST)
    refusal(parse_yaml, "a.yaml", "[" * (DEEPEST + 1) + "]" * (DEEPEST + 1))


@pytest.mark.parametrize("number", ["0x" + "f" * 6000, ":".join(["59"] * 5000), "9" * 101, "0b" + "1" * 200])
def test_yaml_of_numbers_that_python_writes_for_ever_or_not_at_all(number, soon):
    assert "at most 100 digits" in refusal(parse_yaml, "a.yaml", f"seed: {number}")
    assert parse_yaml("a.yaml", "seed: 0x" + "f" * 60)["seed"] == 16**60 - 1


def test_yaml_of_many_keys(soon):
    assert "keys and values" in refusal(parse_yaml, "a.yaml", "".join(f"k{k}: 1\n" for k in range(60_000)))


def test_yaml_of_many_references_to_keys():
    text = "a: x\n" + "".join(f"b{k}: ${{a}}\n" for k in range(MOST_REFERENCES))
    assert len(parse_yaml("a.yaml", text)) == MOST_REFERENCES + 1
    assert "references" in refusal(parse_yaml, "a.yaml", text + "c: ${a}\n")


def test_an_archive_that_unpacks_to_more_than_any_frame(tmp_path, soon):
    np.savez_compressed(tmp_path / "a.npz", points=np.zeros((MOST_NUMBERS // 3 + 2, 3), np.int8))
    with np.load(tmp_path / "a.npz") as found:
        assert found["points"].nbytes < 8 * MOST_NUMBERS
    refusal(read_npz, written(tmp_path / "b.npz", (tmp_path / "a.npz").read_bytes()[:-9]))


@pytest.mark.parametrize("rate", [0.0, -30.0, float("nan"), float("inf"), 1e300, 0.01])
def test_rates(rate, tmp_path):
    assert "found" in refusal(check_rate, "a.bvh", rate)
    assert "rate_hz must be between 0.1 and 100000 Hz" in refusal(PointFiles, str(tmp_path), rate_hz=rate)
    refusal(read_markers, written(tmp_path / "a.trc", TRC.replace("60\t60", f"{rate}\t60")))


def test_places_beyond_the_earth(tmp_path):
    far = BVH.replace("1 2 3 4", "1e11 2 3 4")
    assert "expected positions up to 1e+07 m, found 1e+09 m" in refusal(read_bvh, written(tmp_path / "a.bvh", far))
    (tmp_path / "points").mkdir()
    written(tmp_path / "points" / "a.csv", "x,y,z\n1,2,1e8\n")
    with pytest.raises(InputError, match=r"a\.csv: expected positions up to 1e\+07 m, found 1e\+08 m"):
        _ = PointFiles(str(tmp_path / "points")).known


def test_pixels_beyond_any_image(tmp_path):
    marks = "frame,joint,u,v,visible\n3,neck,1e8,23,1\n"
    assert "u must lie within 1e+07 px" in refusal(read_marks, written(tmp_path / "a.csv", marks))
    people = {"people": [{"pose_keypoints_2d": [1e8, 1.0, 1.0] * 25}]}
    written(tmp_path / "a_1.json", json.dumps(people))
    assert "a_1.json" in refusal(read_openpose, tmp_path)


def test_limbs_and_movements_of_nobody(tmp_path, monkeypatch):
    assert f"at most {LONGEST_LIMB_M} m" in refusal(from_height, 1.7, thigh=1.6)
    (subject,) = subjects(1, np.random.default_rng(0))
    write_bandai_like(tmp_path / "a.bvh", walker(subject, 0.2, 30.0))
    sources.load_motion(tmp_path / "a.bvh")
    monkeypatch.setattr("workbench.mocap.retarget.MOST_LEFT_MM", 1e-3)
    assert "expected at most 0.001 mm" in refusal(sources.load_motion, tmp_path / "a.bvh")


def test_sizes_of_a_configuration():
    usual = {"n_particles": 100_000, "layers": 5, "most_points": 10**8, "resampling": "systematic", "plain": True}
    check_sizes({"seed": 2**40, "inference": usual, "a": [1, None, "b", LARGEST, -LARGEST], "sigma": 1e-300})
    check_sizes({"dataset": {"focal_px": LARGEST_PX, "distance_m": 4.0, "rate_hz": 30.0}})


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("inference.n_particles", 10**9), ("dataset.n_frames", MOST_COUNT + 1), ("seed", 10**400),
        ("a.n_points", 10**8), ("dataset.width", 10**6), ("dataset.focal_px", 1e308), ("dataset.focal_px", -1e308),
        ("dataset.focal_px", 10**8), ("dataset.person_px", np.inf), ("likelihood.sigma", np.nan),
        ("dataset.noise", -np.inf), ("prior.sigma", 1e10), ("study.baseline_m", 1e8), ("dataset.rate_hz", 1e6),
        ("inference.move.layers", 1001), ("inference.steps", 10**6), ("inference.patience", 10**7),
        ("inference.most_points", 10**10), pytest.param("seed", 1 << 20_000, id="more digits than Python writes"),
    ],
)  # fmt: skip
def test_numbers_that_no_run_can_have(place, value):
    """Each is refused by its place, in a mapping or in a list of it."""
    for found in (value, [1, value]):
        config = {place.rpartition(".")[2]: found}
        for group in place.split(".")[-2::-1]:
            config = {group: config}
        assert refusal(check_sizes, config).startswith(f"config: {place}: expected a number up to ")


@pytest.mark.parametrize("place", ["dataset.n_frames", "inference.n_particles", "likelihood.terms.a.n_particles"])
def test_a_run_has_a_frame_and_a_particle(place):
    """What counts something else may be 0; a number that nobody has said is none."""
    *groups, key = place.split(".")

    def config(found):
        whole = {key: found, f"{key}_shown": 0}
        for group in reversed(groups):
            whole = {group: whole}
        return whole

    for found, last in ((0, 0), (-3, -3), ([5, 0], 0)):
        assert refusal(check_sizes, config(found)) == f"config: {place}: expected at least 1, found {last}"
    for found in (1, None):
        check_sizes(config(found))


@pytest.mark.parametrize(
    "keys",
    ["dataset.n_frames=100_000 dataset.width=10_000 dataset.height=10_000", "dataset.clutter=1e9",
     "inference.lag=100_000 inference.n_particles=1_000_000", "inference.n_paths=1_000_000 dataset.n_frames=1_000_000",
     "dataset.n_frames=1_000_000 recorder.marginal_bins=1024", "study.n_draws=1_000_000 study.n_probes=1_000_000",
     "dataset.clutter=nan"],
)  # fmt: skip
def test_sizes_that_only_keys_together_make(keys, monkeypatch):
    monkeypatch.setattr("workbench.limits.memory_bytes", lambda: 24_000_000_000)
    config = {}
    for key, _, value in (text.partition("=") for text in keys.split()):
        group, _, name = key.partition(".")
        config.setdefault(group, {})[name] = float(value) if "e" in value or "n" in value else int(value)
    if "nan" not in keys:
        check_sizes(config)  # which are no sizes of their own
    said = refusal(check_products, config)
    assert all(key.partition("=")[0] in said for key in keys.split())
    assert "GB" in said
    check_products({"dataset": {"n_frames": None, "width": 640, "height": 480}, "inference": {"lag": 5}, "study": None})


def test_memory_is_bounded_and_then_no_more():
    with bounded_memory(100_000_000), pytest.raises(MemoryError):
        np.ones(50_000_000)
    assert np.ones(50_000_000).nbytes == 400_000_000
