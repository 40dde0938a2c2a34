"""pycolmap without the handler of SIGTERM that its import puts in place, which prints a stack of
C++ and dies.
"""

import signal
import threading

_handler = signal.getsignal(signal.SIGTERM)

import pycolmap  # noqa: E402, the handler is asked for before

if threading.current_thread() is threading.main_thread() and _handler is not None:
    signal.signal(signal.SIGTERM, _handler)

__all__ = ["pycolmap"]
