"""What refusals of clips have in common."""

from unshutter.cli import main


def refused(capsys, words, code, *told):
    """The one line in which a clip is refused."""
    assert main(["video", *map(str, words)]) == code
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and all(word in lines[0] for word in told), lines
    return lines[0]


def left_behind(folder):
    """What a run has left of its output."""
    return sorted(path.name for path in folder.iterdir() if path.name.startswith((".", "out")))
