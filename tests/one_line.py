"""The output of a command that cannot be carried out: one line, and nothing else."""

from __future__ import annotations

from moar_companion.commands import cli


def one_line(argv, status, capsys):
    """The one line with which a command ends, without the program's name; its status is checked."""
    assert cli.main([str(word) for word in argv]) == status
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("moar-companion: ")
    assert err.endswith("\n")
    assert err[:-1].isprintable()
    return err[:-1].removeprefix("moar-companion: ")
