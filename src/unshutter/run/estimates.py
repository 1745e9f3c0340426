"""What ``unshutter estimate`` says about a photo."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from unshutter.api import motion_of_lines
from unshutter.errors import visible
from unshutter.export import plot_motion
from unshutter.motion.finding import candidates_to_json
from unshutter.motion.verdict import Speed, Verdict, json_with_speed, judge
from unshutter.options import Estimate, Undo
from unshutter.run.ahead import Begun
from unshutter.run.report import Tell, about
from unshutter.single.drawn_lines import read_lines


@dataclass(frozen=True)
class Answer:
    """What is found about a photo: lines for people, and JSON for programs."""

    photo: Path
    lines: list[str]
    json: str

    def report(self, target: Path | None, as_json: bool, tell: Tell) -> None:
        """Prints the answer: JSON, or else lines, which go to standard error if there is JSON, also in a file."""
        for number, line in enumerate(self.lines):
            if target is None and not as_json:
                print(visible(f"{self.photo}: {line}"))
            else:
                tell(f"{self.photo}: {line}" if target is None or number else f"{self.photo} -> {target}: {line}")
        if target is None and as_json:
            print(self.json)


def describe_motion(begun: Begun, request: Estimate, tell: Tell) -> Answer:
    """Returns a photo's motion as a line for people and as JSON, and draws the plot asked for."""
    source = begun.wanted.path
    readout_ms = request.find.camera.readout_ms
    verdict = begun.verdict if request.lines is None else _judge_lines(begun, request.lines, request, tell)
    found = verdict.finding
    if found.reason:
        line = f"no motion ({found.reason})"
    elif not verdict.changes:
        line = f"rectify leaves it unchanged ({about(verdict)})"
    else:
        chosen = found.candidates[(request.find.candidate or 1) - 1 :][:1]
        line = ", ".join([*(each.name for each in chosen), about(verdict)])
    if request.plot:
        plot_motion(found, request.plot, title=source.name, readout_ms=readout_ms)
    if readout_ms is None:
        return Answer(source, [line], found.to_json())
    line = f"{line}; {Speed.of(found.motion, readout_ms).described()}"
    return Answer(source, [line], json_with_speed(found, readout_ms))


def _judge_lines(begun: Begun, file: Path, request: Estimate, tell: Tell) -> Verdict:
    """Returns the verdict on the motion that straightens lines drawn in a photo, and reports lines that stay askew."""
    lines = read_lines(file)
    straightened = motion_of_lines(begun.photo, lines, request.find.camera)
    for number, (line, trouble) in enumerate(zip(lines, straightened.troubles, strict=True), 1):
        if trouble:
            tell(f"{begun.wanted.path}: line {number} ({line.kind}) stays askew: {trouble.sentence}")
    return judge(straightened.finding, Undo(request.reference))


def list_candidates(begun: Begun, request: Estimate) -> Answer:
    """Returns the candidates of a photo, each in a line, and all as JSON."""
    listed = [candidate.rereferenced(request.reference) for candidate in begun.verdict.finding.candidates]
    lines = [f"{number}  {each.described()}: --candidate {number}" for number, each in enumerate(listed, 1)]
    return Answer(begun.wanted.path, lines, candidates_to_json(listed))
