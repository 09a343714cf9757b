"""Public names of `lb.reading`; each is imported when it is first used."""

from .import_result import Imported as Imported
from .layout import Layout as Layout
from .layout import read_layout as read_layout
from .masks import mask_angles as mask_angles
from .masks import mask_reversals as mask_reversals
