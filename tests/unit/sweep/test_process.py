"""The processes that jobs run in."""

from types import SimpleNamespace

from workbench.sweep import process


def test_a_process_is_told_of_so_many_jobs_and_then_another_begins(tmp_path, monkeypatch):
    started = []

    def start(*_, **__):
        started.append(SimpleNamespace(poll=lambda: None, wait=lambda: 0))
        return started[-1]

    monkeypatch.setattr(process, "Popen", start)
    monkeypatch.setattr(process, "_MOST_JOBS", 2)
    monkeypatch.setattr(process, "_waiting", [])
    with (tmp_path / "out").open("wb") as out:
        for n_processes in (1, 1, 2, 2, 3):
            one = process.process_for(out)
            assert len(started) == n_processes
            one.begin("walk", tmp_path, out.fileno(), out)
            process._waiting.append(one)
