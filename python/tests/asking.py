"""Threads that go on asking while a tree changes."""

import threading

import numpy as np


def answers_during(ask, change):
    """What two threads were answered, again and again, while `change` was called with 1 to 100."""
    found, done = [], threading.Event()

    def go_on():
        while not done.is_set():
            found.append(ask())

    askers = [threading.Thread(target=go_on) for _ in range(2)]
    for asker in askers:
        asker.start()
    try:
        for number in range(1, 101):
            change(number)
    finally:
        done.set()
        for asker in askers:
            asker.join()
    return found


def assert_each_is_one_of(found, expected):
    assert found
    for answer in found:
        assert any(np.array_equal(answer, of) for of in expected)
