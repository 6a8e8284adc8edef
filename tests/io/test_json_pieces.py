"""A JSON file read entry by entry is what it is as a whole, wherever the pieces end."""

import json

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from deformer import InputError
from deformer.io import json_pieces
from deformer.io.json_pieces import read_pieces
from deformer.io.json_values import read_value

TEXTS = st.text('ab"\\\n{[:,é𝄞', max_size=3)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | TEXTS
    | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(TEXTS, inner, max_size=2),
    max_leaves=8,
)  # fmt: skip
FILES = st.dictionaries(st.sampled_from(["list", "a", "é", ""]), VALUES, max_size=4)
FAULTS = [
    '{"list": [1, 2}',
    '{"list": [1 2]}',
    '{"list": [1,]}',
    '{"list": [',
    '{"list": [1, nul]}',
    '{"list": [1, NaN]}',
    '{"list": [1, [2, Infinity]]}',
    '{"list": [1e999]}',
    '{"list": ["\\ud800"]}',
    '{"list": [1], "list": [2]}',
    '{"list": [{"a": 1, "a": 2}]}',
    '{"list": [1]\n"a": 2}',
    '{"list": [1],\n\n a: 2}',
    '{"list" [1]}',
    '{"list": [1]} 2',
    '{"list": [1], "a": "x',
    '{"list": [1], "a": 12345678901e}',
    "[1, 2]",
    "  3",
    "x",
    '{"list": [' + "[" * 97 + "]" * 97 + "]}",
    '{"list": [' + "[" * 98 + "[1]" + "]" * 98 + "]}",
    '{"list": [' + "[" * 9000 + "]" * 9000 + "]}",
    '{"list": [' + "1" * 5000 + "]}",
]


@pytest.fixture(params=[1, 2, 7, 1 << 20])
def chunk(request, monkeypatch):
    monkeypatch.setattr(json_pieces, "_CHUNK", request.param)


def pieces(path):
    entries = []
    root = read_pieces(path, "list", entries.append)
    return root, entries


def check_equal(path):
    root, entries = pieces(path)
    whole = read_value(path).value
    found = dict(root.value)
    if isinstance(whole.get("list"), list):
        assert found["list"] == []
        found["list"] = [entry.value for entry in entries]
        assert [str(entry) for entry in entries] == [
            f"{path}: list[{n}]" for n in range(len(entries))
        ]
    assert repr(found) == repr(whole)


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    max_examples=40,
)
@given(data=FILES, indent=st.sampled_from([None, 1]), ascii_only=st.booleans(),
       encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-32-le"]))  # fmt: skip
def test_the_entries_are_those_of_the_whole(tmp_path, chunk, data, indent, ascii_only, encoding):
    path = tmp_path / "a.json"
    text = json.dumps(data, indent=indent, ensure_ascii=ascii_only)
    path.write_bytes(text.encode(encoding, "surrogatepass"))
    check_equal(path)


@pytest.mark.parametrize("number", ["-0", "1.5e-3", "1E+22", "12.25", "0.1", "123456789012345678"])
def test_numbers_are_not_cut_where_a_piece_ends(tmp_path, chunk, number):
    path = tmp_path / "a.json"
    path.write_text(f'{{"a":{number},"list":[{number},{number}]}}')
    check_equal(path)


@pytest.mark.parametrize("text", FAULTS, ids=lambda text: text[:24])
def test_what_is_no_json_is_told_as_of_the_whole(tmp_path, chunk, text):
    path = tmp_path / "a.json"
    path.write_text(text)
    try:
        read_value(path)
    except InputError as error:
        expected = str(error)
    else:
        check_equal(path)
        return
    with pytest.raises(InputError) as found:
        pieces(path)
    told = str(found.value)
    if "nested" in told:  # told with the entry that has it, as far as it was parsed
        told = told.replace("list[0]: ", "")
    assert told == expected


def test_a_byte_that_is_no_text_is_told_by_its_place(tmp_path, chunk):
    path = tmp_path / "a.json"
    path.write_bytes(b'{"list": [1, "\xc3\xa9", "\xff"]}')
    with pytest.raises(InputError, match=r"byte 20 is no UTF-8"):
        pieces(path)


def test_entries_come_before_the_rest_is_read(tmp_path, monkeypatch):
    """The first entry is there long before a fault at the end of the file is."""
    monkeypatch.setattr(json_pieces, "_CHUNK", 64)
    path, found = tmp_path / "a.json", []
    path.write_text('{"list": [' + ", ".join(map(str, range(1000))) + ", x]}")
    with pytest.raises(InputError, match="not JSON"):
        read_pieces(path, "list", lambda entry: found.append(entry.value))
    assert found == list(range(1000))
