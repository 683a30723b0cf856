"""`workbench annotate` prints the address of its page, serves it, and counts the annotations."""

from workbench.cli import annotate
from workbench.cli.main import main


def test_the_page_is_opened_and_annotations_are_counted(images, tmp_path, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr(annotate.webbrowser, "open", opened.append)
    monkeypatch.setattr(annotate, "serve", lambda server: server.annotations.put((1, "neck"), (3.0, 4.0, True)))
    assert main(["annotate", str(images), "-o", str(tmp_path / "m.csv")]) == 0
    output = capsys.readouterr().out
    assert opened[0].startswith("http://127.0.0.1:")
    assert opened[0] in output
    assert "m.csv: 0 joints in 0 of 3 frames" in output
    assert output.endswith("m.csv: 1 joints in 1 of 3 frames\n")


def test_a_missing_output_folder_is_rejected_with_one_message(images, capsys):
    assert main(["annotate", str(images), "-o", str(images / "none" / "m.csv"), "--no-browser"]) == 2
    message = capsys.readouterr().err
    assert "expected a folder" in message
    assert message.count("\n") == 1
