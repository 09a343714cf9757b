"""Import of foreign files, such as spreadsheets and exports of instruments, as campaigns.

Foreign files are tables that were not written by this package. They may have any format.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
