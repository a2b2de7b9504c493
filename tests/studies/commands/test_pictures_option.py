"""`--pictures`: one option of every command that reads an Experiment, and a note of what is not used."""

from __future__ import annotations

import pytest
from small_sheet import stretched

from calibrate.errors import ConfigError
from studies import cli
from studies.commands.discover import read
from studies.errors import OptionError
from studies.output.alerts import alert_of
from studies.reports.experiments.experiment_findings import pictures


def test_discover_reads_the_pictures_asked_for(tmp_path):
    stretched().save(tmp_path / "a.npz")
    (found,), _, _ = read([tmp_path / "a.npz"], [], None, (1, 3))
    assert found.time.tolist() == [1.0, 3.0]
    (told,) = pictures(found)
    assert "2 of the 3 pictures" in told.text and "as asked for" in told.text
    assert told.alert is alert_of("experiment", "pictures_used")
    (everything,), _, _ = read([tmp_path / "a.npz"], [], None)
    assert everything.n_increments == 3 and not pictures(everything)


def test_a_replay_of_some_pictures_says_so(tmp_path, capsys):
    stretched().save(tmp_path / "a.npz")
    words = [
        "replay",
        tmp_path / "a.npz",
        "neo_hooke",
        "--parameter",
        "mu=0.3",
        "--pictures",
        "2",
        "--skip-mesh-check",
        "-o",
        tmp_path / "out",
    ]
    assert cli.main([str(word) for word in words]) == 0
    assert "D109: 2 of the 3 pictures" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "error", "said"),
    [
        (("predict", "model.json", "--pictures", "3"), OptionError, "belongs to --test"),
        (("calibrate", "treloar-a", "--pictures", "3"), ConfigError, "not for curves"),
        (("replay", "{}", "neo_hooke", "--pictures", "1,7"), ConfigError, "1 to 3"),
        (("calibrate", "{}", "--pictures", "some"), OptionError, "write all, a number"),
    ],
)
def test_what_cannot_be_is_named(monkeypatch, tmp_path, words, error, said):
    monkeypatch.setenv("EQUIGAP_DEBUG", "1")
    stretched().save(tmp_path / "a.npz")
    with pytest.raises(error, match=said):
        cli.main([word.format(tmp_path / "a.npz") for word in words] + ["-o", str(tmp_path / "out")])
