"""What is told of a process that has ended, by its status and its log."""

import signal

from processes.ended import NUM_LINES, Ended, last_lines

FRAMES = [f'  File "{name}.py", line 1 in {name}' for name in "abcdefghijkl"]
CRASH = "Fatal Python error: Aborted"
WHY = "terminate called after throwing an instance of 'std::bad_alloc'"


def test_of_a_crash_what_was_said_before_and_where_it_was_are_told() -> None:
    log = ["one", "two", "three", WHY, "", CRASH, "", "Thread 0x1:", *FRAMES[:3]]
    log += ["Current thread 0x2:", *FRAMES[3:], "", "Extension modules: numpy (total: 1)"]
    assert last_lines("\n".join(log)) == ("three", WHY, CRASH, *FRAMES[3:8])


def test_want_of_memory_is_found_among_the_frames_of_two_that_crash_at_once() -> None:
    log = [WHY, CRASH, "Current thread 0x1:", *FRAMES, CRASH, "Current thread 0x2:", *FRAMES]
    said = last_lines("\n".join(log))
    assert said[0] == WHY and len(said) == NUM_LINES and CRASH in said
    assert Ended(-signal.SIGABRT, said).wanted_memory
    assert not Ended(-signal.SIGSEGV, said).wanted_memory


def test_without_a_crash_the_last_lines_are_told() -> None:
    assert last_lines("\n".join(FRAMES)) == tuple(FRAMES[-NUM_LINES:])
