"""Help for several tests."""

import _thread
import threading
import time

import pytest


@pytest.fixture
def interrupted():
    """Calls something that takes long, with Ctrl-C after a while; it must raise within a second, and, unless it
    `goes_on` in the background, end."""

    def call(work, goes_on=False):
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
            if not goes_on:
                used = time.process_time()
                time.sleep(0.3)
                assert time.process_time() - used < 0.1
        finally:
            timer.cancel()

    return call
