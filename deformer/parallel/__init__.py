"""Tasks side by side: one protocol for this process, processes of this machine, and a cluster.

The names that other packages may use are listed in `__init__.pyi`; each is loaded when it is
first asked for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
