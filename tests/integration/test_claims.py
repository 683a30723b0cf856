"""`python -m analysis.claims`: claims of the papers, at small size on generated people."""

import pytest

from analysis.claims.__main__ import main


@pytest.mark.slow
def test_two_claims_hold_and_are_measured_once(tmp_path, cache, monkeypatch, capsys, caplog):
    monkeypatch.setenv("WORKBENCH_CACHE", str(cache))
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    arguments = ["B1", "C3", "--quick", "--runs", str(tmp_path)]
    assert main(arguments) == 0
    first = capsys.readouterr().out
    assert "runs to make" in caplog.text
    verdicts = {tuple(line.split()[:2]): line for line in first.splitlines()[1:]}
    assert verdicts.keys() == {(name, paper) for name in ("B1", "C3") for paper in ("literal", "ours")}
    for name, paper in (("B1", "literal"), ("B1", "ours"), ("C3", "ours")):
        assert verdicts[name, paper].endswith("  holds")
    assert verdicts["C3", "literal"].endswith("does not hold, known")  # the paper's tree approximates the odds
    caplog.clear()
    assert main(arguments) == 0
    assert capsys.readouterr().out == first
    assert "runs to make" not in caplog.text
