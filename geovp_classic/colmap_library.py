"""pycolmap without its handler of SIGTERM, which prints a C++ stack trace and aborts."""

import signal
import threading

_handler = signal.getsignal(signal.SIGTERM)

import pycolmap  # noqa: E402, the handler is read before

if threading.current_thread() is threading.main_thread() and _handler is not None:
    signal.signal(signal.SIGTERM, _handler)

__all__ = ["pycolmap"]
