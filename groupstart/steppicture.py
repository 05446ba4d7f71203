"""The picture of a tuned axis: its steps before and after, forward and back. matplotlib is imported only here."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from machines.servobench import Response
    from machines.tuning import Tuned

BEFORE, AFTER, GOAL = "#9aa3ad", "#1f6feb", "#24292f"
SHOWN_MS = 120


def draw_steps(path: Path, title: str, tuned: Tuned) -> None:
    """Write the picture to ``path``; its ending (.png, .svg) names the format. Raises OSError where the disk does."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.2), dpi=140, facecolor="white", layout="constrained")
    figure.suptitle(title)
    for place, words in enumerate(("forward", "back")):
        axes = figure.add_subplot(1, 2, place + 1)
        pairs: list[tuple[str, str, Response]] = [
            ("before", BEFORE, tuned.before[place]),
            ("after", AFTER, tuned.after[place]),
        ]
        for label, colour, response in pairs:
            axes.step(response.time_ms, response.position, where="post", color=colour, label=label, linewidth=1.4)
        step = tuned.after[place].step
        axes.plot([0, 0, SHOWN_MS], [0, step, step], color=GOAL, linewidth=0.8, linestyle="--", label="command")
        axes.set_xlim(-2, SHOWN_MS)
        axes.set_xlabel("ms")
        axes.set_ylabel(f"counts {words}")
        axes.grid(alpha=0.3)
        axes.legend(loc="lower right")
    figure.savefig(path)
