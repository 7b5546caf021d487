import threading

from yahboomd.bus.sender import Sender


def test_work_is_done_in_order_by_one_thread():
    sender, done = Sender("test-sender"), []
    for number in range(100):
        assert sender.send(lambda number=number: done.append((number, threading.current_thread())))
    assert sender.close(20)
    assert [number for number, _ in done] == list(range(100))
    assert len({thread for _, thread in done}) == 1
    assert done[0][1] is not threading.current_thread()


def test_no_thread_before_the_first_work():
    before = threading.active_count()
    assert Sender("idle").close(20)
    assert threading.active_count() == before


def test_a_stuck_thread_bounds_the_queue_and_does_not_hold_the_caller():
    release, sender = threading.Event(), Sender("stuck-sender")
    taken = 0
    while sender.send(release.wait) and taken < 10_000:
        taken += 1
    assert taken < 1_000
    assert not sender.close(0.01)
    release.set()
    assert sender.close(20)
