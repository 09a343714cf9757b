"""Progress of long work: a bar on stderr, none where stderr is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from ldbb_bayes.inference.mcmc import Progress as SamplingState

__all__ = ["counting_progress", "sampling_progress", "step_progress", "steps_of"]

# Is told how many of how many are done.
Tell = Callable[..., None]
# Begins a named step and returns what is told of it.
Begin = Callable[[str], Tell | None]


class _BarState(NamedTuple):
    share: float
    text: str


@contextmanager
def _progress_bar(
    state_of: Callable[..., _BarState], quiet: bool, title: str
) -> Iterator[Tell | None]:
    """Show a bar; ``state_of`` makes its share and text of what the bar is told."""
    if quiet or not sys.stderr.isatty():
        yield None
        return

    columns = (
        TextColumn(title),
        BarColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)

        def update(*arguments: Any, **keywords: Any) -> None:
            state = state_of(*arguments, **keywords)
            bar.update(task, completed=state.share, description=state.text)

        yield update


def _counting_state(done: int, total: int, failed: int = 0) -> _BarState:
    text = f"{done}/{total}"
    if failed:
        text += f", {failed} failed"
    return _BarState(done / max(total, 1), text)


def _sampling_state(state: SamplingState) -> _BarState:
    ess = min(state.assessment.ess_bulk_min, state.assessment.ess_tail_min)
    text = (
        f"{state.steps} steps, ESS {ess:.0f} of {state.target_ess:.0f}, R-hat"
        f" {state.assessment.rhat_max:.3f}"
    )
    return _BarState(min(ess / state.target_ess, 1.0), text)


def _step_state(share: float, step: str, done: int, total: int) -> _BarState:
    text = f"{step} {done}/{total}" if total else step
    return _BarState(share, text)


def counting_progress(quiet: bool, title: str) -> AbstractContextManager[Tell | None]:
    """Return a bar that is told how many of how many are done, and how many failed.

    Parameters
    ----------
    quiet
        Whether there is to be no bar.
    title
        What is counted.

    Returns
    -------
    context manager
        Of what is told; of None where there is no bar.
    """
    return _progress_bar(_counting_state, quiet, title)


def sampling_progress(quiet: bool, title: str) -> AbstractContextManager[Tell | None]:
    """Return a bar that is told the states of an MCMC run.

    Parameters
    ----------
    quiet
        Whether there is to be no bar.
    title
        What is sampled.

    Returns
    -------
    context manager
        Of what is told; of None where there is no bar.
    """
    return _progress_bar(_sampling_state, quiet, title)


def steps_of(update: Callable[[float, str, int, int], None] | None, **weights: float) -> Begin:
    """Return what begins a named step of longer work.

    Parameters
    ----------
    update
        Is told the share of all steps that is done, the step, and how many of how many of the step
        are done (0 of 0: unknown). None: nothing is told.
    **weights
        How long each step lasts beside the others, in their order.

    Returns
    -------
    callable
        Gets the name of a step that begins and returns what is told of it.
    """
    total_weight = sum(weights.values())
    weight_before: dict[str, float] = {}
    for name in weights:
        weight_before[name] = sum(weights[step] for step in weight_before)

    def begin(step: str) -> Tell | None:
        if update is None:
            return None

        def tell(done: int, total: int, failed: int = 0) -> None:
            weight_done = weight_before[step] + weights[step] * done / max(total, 1)
            update(weight_done / total_weight, step, done, total)

        tell(0, 0)
        return tell

    return begin


@contextmanager
def step_progress(quiet: bool, **weights: float) -> Iterator[Begin]:
    """Show one bar over named steps.

    Parameters
    ----------
    quiet
        Whether there is to be no bar.
    **weights
        As of `steps_of`.

    Yields
    ------
    callable
        As `steps_of` returns.
    """
    with _progress_bar(_step_state, quiet, "report") as update:
        yield steps_of(update, **weights)
