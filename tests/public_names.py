"""The public names: those of `lb`, and of its rooms, such as `lb.terms.Drift`."""

from __future__ import annotations

import inspect

import ldbb_bayes as lb

__all__ = ["public_names"]


def public_names() -> list[str]:
    """Return every public function and class as it is written behind ``lb.``."""
    rooms = [name for name in lb.__all__ if inspect.ismodule(getattr(lb, name))]
    names = set(lb.__all__) - set(rooms) - {"__version__"}
    for room_name in rooms:
        room = getattr(lb, room_name)
        for name in room.__all__:
            member = getattr(room, name)
            if inspect.isfunction(member) or inspect.isclass(member):
                names.add(f"{room_name}.{name}")
    return sorted(names)
