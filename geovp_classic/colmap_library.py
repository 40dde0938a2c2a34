"""pycolmap without its handler of SIGTERM, which prints a C++ stack trace and aborts."""

import signal
import threading

_handler = signal.getsignal(signal.SIGTERM)

try:
    import pycolmap  # the handler is read before
except RuntimeError as error:  # of any failure; an interrupt is the cause of its cause
    raise getattr(error.__cause__, "__cause__", None) or error from error.__cause__

if threading.current_thread() is threading.main_thread() and _handler is not None:
    signal.signal(signal.SIGTERM, _handler)

__all__ = ["pycolmap"]
