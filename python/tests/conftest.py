"""Help for several tests."""

import _thread
import threading
import time

import pytest


@pytest.fixture
def interrupted():
    """Calls something that takes long, with Ctrl-C after a while; it must end within a second."""

    def call(work):
        pressed = []

        def press():
            pressed.append(time.monotonic())
            _thread.interrupt_main()

        timer = threading.Timer(0.3, press)
        timer.start()
        try:
            with pytest.raises(KeyboardInterrupt):
                work()
            assert pressed and time.monotonic() - pressed[0] < 1
        finally:
            timer.cancel()

    return call
