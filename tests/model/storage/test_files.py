"""Errors of writing keep their cause."""

import errno
import pickle

import pytest

from model.storage.files import WriteError, written_atomically


@pytest.mark.parametrize("through_a_process", [False, True])
def test_a_write_error_is_one_sentence_and_knows_its_cause(through_a_process, tmp_path):
    with pytest.raises(WriteError) as caught, written_atomically(tmp_path / "a.npz"):
        raise OSError(errno.ENOSPC, "No space left on device")
    error = pickle.loads(pickle.dumps(caught.value)) if through_a_process else caught.value
    assert isinstance(error, WriteError) and error.errno == errno.ENOSPC
    assert str(error) == (
        f"{tmp_path / 'a.npz'} could not be written: the disk is full; free some space or choose "
        "another folder."
    )
