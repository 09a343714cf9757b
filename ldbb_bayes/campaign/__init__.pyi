"""Public names of `lb.campaign`; each is imported when it is first asked for."""

from .campaign import ForceLaw as ForceLaw
from .campaign import MountCompensation as MountCompensation
from .dcc_reader import read_dcc as read_dcc
