"""Files of named arrays: what is written comes back, and what is damaged is refused by name."""

import json

import numpy as np
import pytest

from deformer import InputError, io


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "a.safetensors"
    io.write_tensors(path, {"a": np.arange(6.0).reshape(2, 3).T, "b": np.array(3)}, {"of": "{}"})
    return path


def test_arrays_and_metadata_come_back(file):
    found = io.read_tensors(file)
    assert set(found) == {"a", "b"} and found["b"].shape == ()
    assert found["a"].tolist() == [[0, 3], [1, 4], [2, 5]]  # though not contiguous
    assert io.read_metadata(file, "of").value == {}
    with pytest.raises(InputError, match=r"a\.safetensors: no 'who' in its header; "):
        io.read_metadata(file, "who")


@pytest.mark.parametrize("read", [io.read_tensors, lambda path: io.read_metadata(path, "of")])
@pytest.mark.parametrize("length", [0, 1, 7, 8, 20, -1])
def test_a_file_that_is_cut_is_refused(file, read, length):
    file.write_bytes(file.read_bytes()[:length])
    with pytest.raises(InputError, match=r"a\.safetensors: "):
        read(file)


@pytest.mark.parametrize("read", [io.read_tensors, lambda path: io.read_metadata(path, "of")])
def test_a_long_header_is_refused_before_it_is_parsed(file, read):
    """Its parser takes many times the memory of the text, and would accept this one."""
    header = json.dumps({"__metadata__": {"of": "{}", "x": "x" * 2_000_000}}).encode()
    file.write_bytes(len(header).to_bytes(8, "little") + header)
    with pytest.raises(InputError, match=r"a\.safetensors: a header of \d+ bytes, expected"):
        read(file)
