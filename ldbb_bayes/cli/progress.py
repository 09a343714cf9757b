"""Progress of long computations: a bar on stderr if stderr is a terminal."""

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

# Function that updates a progress bar. It usually has two arguments: the number of finished items,
# such as fits, and the number of all items.
Tell = Callable[..., None]
# Function that begins a named step of a computation, and returns the function that reports the
# progress of this step.
Begin = Callable[[str], Tell | None]


class _BarState(NamedTuple):
    """State of a progress bar: the completed fraction, from 0 to 1, and the text beside the bar."""

    share: float
    text: str


@contextmanager
def _progress_bar(
    state_of: Callable[..., _BarState], quiet: bool, title: str
) -> Iterator[Tell | None]:
    """Show a progress bar on stderr, and yield the function that updates the bar.

    No bar is shown, and None is yielded, if ``quiet`` is true or stderr is not a terminal. The
    arguments of the yielded function are passed on to ``state_of``, which returns the completed
    fraction and the text beside the bar. ``title`` is shown in front of the bar.
    """
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
            """Update the progress bar with the fraction and the text that ``state_of`` returns."""
            state = state_of(*arguments, **keywords)
            bar.update(task, completed=state.share, description=state.text)

        yield update


def _counting_state(done: int, total: int, failed: int = 0) -> _BarState:
    """Return the completed fraction and the text of a progress bar that counts items."""
    text = f"{done}/{total}"
    if failed:
        text += f", {failed} failed"
    return _BarState(done / max(total, 1), text)


def _sampling_state(state: SamplingState) -> _BarState:
    """Return the completed fraction and the text of a progress bar for the sampling of a posterior.

    The fraction is the effective sample size reached so far, divided by the required size.
    """
    ess = min(state.assessment.ess_bulk_min, state.assessment.ess_tail_min)
    text = (
        f"{state.steps} steps, ESS {ess:.0f} of {state.target_ess:.0f}, R-hat"
        f" {state.assessment.rhat_max:.3f}"
    )
    return _BarState(min(ess / state.target_ess, 1.0), text)


def _step_state(share: float, step: str, done: int, total: int) -> _BarState:
    """Return the completed fraction and the text of a progress bar for several named steps."""
    text = f"{step} {done}/{total}" if total else step
    return _BarState(share, text)


def counting_progress(quiet: bool, title: str) -> AbstractContextManager[Tell | None]:
    """Return a context manager that shows a progress bar for items such as campaigns.

    The bar shows the number of finished items, the number of all items, and the number of items
    that have failed.

    Parameters
    ----------
    quiet
        Whether to show no bar.
    title
        Title of the bar. It names the things that are counted.

    Returns
    -------
    context manager
        Yields the function that updates the bar, or None if there is no bar.
    """
    return _progress_bar(_counting_state, quiet, title)


def sampling_progress(quiet: bool, title: str) -> AbstractContextManager[Tell | None]:
    """Return a context manager that shows a progress bar for the random sampling of a posterior.

    The bar shows the effective sample size (ESS) of the draws as a fraction of the required size.

    Parameters
    ----------
    quiet
        Whether to show no bar.
    title
        Title of the bar.

    Returns
    -------
    context manager
        Yields the function that updates the bar, or None if there is no bar.
    """
    return _progress_bar(_sampling_state, quiet, title)


def steps_of(update: Callable[[float, str, int, int], None] | None, **weights: float) -> Begin:
    """Return a function that begins a named step of a longer computation.

    Parameters
    ----------
    update
        Function that is called with four arguments: the completed fraction of the whole
        computation, the name of the present step, the number of finished items of this step, and
        the number of all its items (both 0 if unknown). If None, no progress is reported.
    **weights
        Approximate durations of the steps, relative to each other, in the order of the steps. The
        keys are the names of the steps.

    Returns
    -------
    callable
        Function to call with the name of each step when the step begins. It returns the function
        that reports the progress of this step, or None if no progress is reported.
    """
    total_weight = sum(weights.values())
    weight_before: dict[str, float] = {}
    for name in weights:
        weight_before[name] = sum(weights[step] for step in weight_before)

    def begin(step: str) -> Tell | None:
        """Report that a step begins, and return the function that reports the step's progress."""
        if update is None:
            return None

        def tell(done: int, total: int, failed: int = 0) -> None:
            """Report how many items of a computation's step are done, and their total number."""
            weight_done = weight_before[step] + weights[step] * done / max(total, 1)
            update(weight_done / total_weight, step, done, total)

        tell(0, 0)
        return tell

    return begin


@contextmanager
def step_progress(quiet: bool, **weights: float) -> Iterator[Begin]:
    """Show one progress bar for all named steps of a computation.

    Parameters
    ----------
    quiet
        Whether to show no bar.
    **weights
        Approximate durations of the steps, relative to each other; the keys are the names of the
        steps. See `steps_of`.

    Yields
    ------
    callable
        Function that begins a step; see `steps_of`.
    """
    with _progress_bar(_step_state, quiet, "report") as update:
        yield steps_of(update, **weights)
