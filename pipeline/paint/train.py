"""The training of a mesh's colours: steps until they are done."""

from collections.abc import Callable

from pipeline.options.paint import TrainPaint
from pipeline.paint.step import PaintMetrics, PaintState, Pool, paint_step
from pipeline.training.batch import ViewGradient
from pipeline.training.loop import History, take_steps


def train(
    state: PaintState,
    history: History,
    options: TrainPaint,
    pool: Pool,
    view_gradient: ViewGradient,
    *,
    keep: Callable[[PaintState, History], None] = lambda state, history: None,
    show: Callable[[PaintState], None] = lambda state: None,
    stage: str = "train_paint",
    noise_size: int | None = None,
) -> None:
    """Take the steps of a stage that `state` has not done yet; record each in `history`.

    `keep` and `show`: see `training.loop.take_steps`, which also says what is raised; `noise_size`: see
    `paint_step`.
    """

    def step(state: PaintState) -> PaintMetrics:
        return paint_step(state, options, pool, view_gradient, noise_size)

    take_steps(stage, state, history, options, step, keep=keep, show=show)
