"""How far a run is, from the lines that it says and the costs that were estimated before."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from pipeline.progress import duration

_COUNT = re.compile(r"(\w+): (\d+)/(\d+) (\w+)(?:, (?:(\d+) min )?(\d+) s left)?")
_BEGUN = re.compile(r"(\w+) \.\.\.$")
_ENDED = re.compile(r"(\w+): (?:unchanged|reused from .*|(?:\d+ min )?\d+ s)$")


@dataclass
class Progress:
    """Of one run. `hear` takes its lines one by one."""

    seconds: Mapping[str, float]
    """What each stage was estimated to take, in the order of the chain."""
    stage: str = ""
    """That is running."""
    step: str = ""
    """What it said last of how far it is."""
    share: float = 0.0
    """Of that stage, in [0, 1]."""
    stage_left: float | None = None
    """What that stage still takes, as it says [seconds]."""
    done: set[str] = field(default_factory=set)
    warnings: list[str] = field(default_factory=list)

    def hear(self, line: str) -> None:
        """Take one line of a run's standard error."""
        line = line.strip()
        if match := _COUNT.match(line):
            self._at(match[1])
            count, total = int(match[2]), int(match[3])
            self.share, self.step = min(count / max(total, 1), 1.0), f"{count} of {total} {match[4]}"
            if match[6] is not None:
                self.stage_left = 60 * int(match[5] or 0) + int(match[6])
        elif match := _BEGUN.match(line):
            self._at(match[1])
        elif (match := _ENDED.match(line)) and match[1] in self.seconds:
            self.done.add(match[1])
            self.stage, self.step, self.share, self.stage_left = "", "", 0.0, None
        elif line.startswith("warning: "):
            self.warnings.append(line.removeprefix("warning: "))

    def _at(self, stage: str) -> None:
        if stage in self.seconds and stage != self.stage:
            self.stage, self.step, self.share, self.stage_left = stage, "", 0.0, None

    def part(self) -> float:
        """Return how much of the whole is done, in [0, 1]: stages weigh what they were estimated to take."""
        total = sum(self.seconds.values()) or 1.0
        done = sum(self.seconds[name] for name in self.done)
        return min((done + self.share * self.seconds.get(self.stage, 0.0)) / total, 1.0)

    def left(self) -> float:
        """Return what the run still takes [seconds]. Stages that have not begun take their estimates, longer
        or shorter by the root of how wrong the estimate of the running one is: they wait for other things."""
        total, estimated = sum(self.seconds.values()), self.seconds.get(self.stage, 0.0)
        later = max((1 - self.part()) * total - (1 - self.share) * estimated, 0.0)
        current = (1 - self.share) * estimated
        if self.stage_left is None:
            return current + later
        scale = self.stage_left / current if self.share > 0.05 and current > 1 else 1.0
        return float(self.stage_left + later * min(max(scale, 0.1), 10.0) ** 0.5)

    def told(self, elapsed: float) -> dict[str, object]:
        """Return it as the API tells it."""
        left = self.left()
        return {
            "stage": self.stage,
            "step": self.step,
            "part": round(self.part(), 4),
            "seconds": round(elapsed, 1),
            "left": round(left, 1),
            "left_text": f"about {duration(left)} left",
            "warnings": self.warnings,
        }
