"""Fixtures for several tests."""

import _thread
import signal
import threading
import time
from pathlib import Path

import pytest

# A shell that starts the tests in the background makes them ignore Ctrl-C, which some of them press.
signal.signal(signal.SIGINT, signal.default_int_handler)


def threads():
    """Number of threads of this process, including those left by other tests; 0 on systems that do not tell."""
    tasks = Path("/proc/self/task")
    return len(list(tasks.iterdir())) if tasks.is_dir() else 0


@pytest.fixture
def interrupted():
    """Makes a long call and presses Ctrl-C after a while. The call must raise within a second, and its threads must
    end unless it `goes_on` in the background."""

    def call(work, goes_on=False):
        pressed, before = [], threads()

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
                timer.join()
                time.sleep(0.1)
                assert threads() <= before
        finally:
            timer.cancel()

    return call
