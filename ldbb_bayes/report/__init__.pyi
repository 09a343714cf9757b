"""Public names of `lb.report`. Each name is imported when it is first used."""

from . import figures as figures
from .dcc_export import write_dcc as write_dcc
from .fit_description import describe_fit as describe_fit
from .wording import with_words as with_words
