"""The script that changes the code at random: what it draws is the same for the same seed, everywhere, and a change."""

import ast

from mutants import SOURCE, draw


def test_changes_are_drawn_over_all_rooms() -> None:
    drawn = draw(seed=1, count=60)
    assert drawn == draw(seed=1, count=60) != draw(seed=2, count=60)
    assert len(set(drawn)) == 60
    rooms = {path.name for path in SOURCE.iterdir() if (path / "__init__.py").exists()}
    assert rooms <= {mutant.room for mutant in drawn}


def test_a_change_is_still_python_and_means_something_else() -> None:
    for mutant in draw(seed=1, count=60):
        source = (SOURCE / mutant.file).read_bytes()
        changed = mutant.apply(source)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(source)), mutant
        lines = zip(source.splitlines(), changed.splitlines(), strict=False)
        assert next(number for number, (old, new) in enumerate(lines, 1) if old != new) == mutant.line
