"""One thread, one slot, the newest wins."""

from __future__ import annotations

import threading

from uw_recon_ros.ros.worker import Mailbox, Worker


def test_the_newest_wins_and_the_older_is_reported() -> None:
    box: Mailbox[int] = Mailbox()
    assert [box.put(1), box.put(2), box.put(3)] == [False, True, True]
    assert box.get() == 3
    assert not box.put(4)


def test_a_closed_box_dismisses_whoever_waits() -> None:
    box: Mailbox[int] = Mailbox()
    got: list[int | None] = []
    waiter = threading.Thread(target=lambda: got.append(box.get()))
    waiter.start()
    box.close()
    waiter.join(5.0)
    assert got == [None]


def test_clear_tells_whether_something_was_there() -> None:
    box: Mailbox[int] = Mailbox()
    box.put(1)
    assert box.clear()
    assert not box.clear()


def test_the_worker_skips_what_was_overtaken_while_it_was_busy() -> None:
    begun, go_on, done = threading.Event(), threading.Event(), threading.Event()
    seen: list[int] = []

    def work(item: int) -> None:
        seen.append(item)
        begun.set()
        go_on.wait(5.0)
        if item == 3:
            done.set()

    worker = Worker("test", work)
    worker.mailbox.put(1)
    assert begun.wait(5.0)
    assert [worker.mailbox.put(2), worker.mailbox.put(3)] == [False, True]
    go_on.set()
    assert done.wait(5.0)
    assert worker.stop(5.0)
    assert seen == [1, 3]


def test_stop_says_when_the_work_will_not_end() -> None:
    begun, go_on = threading.Event(), threading.Event()

    def work(item: int) -> None:
        begun.set()
        go_on.wait(10.0)

    worker = Worker("test", work)
    worker.mailbox.put(1)
    assert begun.wait(5.0)
    assert not worker.stop(0.05)
    go_on.set()
    assert worker.stop(5.0)
