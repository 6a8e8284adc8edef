"""JSON files: what they may not contain, and messages that name the place."""

import pytest

from deformer import InputError, io

DEEP = 100_000


def refusal(content, tmp_path):
    path = tmp_path / "a.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as caught:
        io.read_value(path)
    message = str(caught.value)
    assert message.startswith(str(path)) and "\n" not in message
    return message.removeprefix(str(path))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (bytes(100), "not JSON"),
        (b"{\xff}", "not JSON"),
        ("{", "line 1: not JSON"),
        ("[]", "list"),
        ("3", "a JSON number"),
        ("null", "a JSON null"),
        ('{"a": ' + "[" * DEEP + "]" * DEEP + "}", "nested more than 100 deep"),
        ('{"a": ' + "[" * 200 + "1" + "]" * 200 + "}", "nested more than 100 deep"),
        ('{"a": ' + "1" * 5000 + "}", "an integer of 5000 digits"),
        ('{"a": [0, NaN]}', "a[1]: expected a finite number, got nan"),
        ('{"a": {"b c": -Infinity}}', "a.'b c': expected a finite number, got -inf"),
        ('{"a": 1e400}', "a: expected a finite number, got inf"),
        ('{"a": [{"b": "x\\ud800"}]}', "a[0].b: expected a text"),
        ('{"a": {"\\udc00": 1}}', "a: expected keys that are texts"),
        ('{"a": {"b": 1, "c": 2, "b": 3}}', "key 'b' is given twice"),
    ],
)
def test_what_is_no_json_is_refused(tmp_path, content, words):
    assert words in refusal(content, tmp_path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_every_encoding_of_unicode_is_read(tmp_path, encoding):
    (tmp_path / "a.json").write_text('{"é": [1, "😀"]}', encoding=encoding)
    assert io.read_json(tmp_path / "a.json") == {"é": [1, "😀"]}


def value(text):
    return io.parse_value(text, "s.json")


@pytest.mark.parametrize(
    ("text", "check", "words"),
    [
        (
            '{"c": {"p": [0, true]}}',
            lambda v: v["c"]["p"].numbers(),
            "s.json: c.p[1]: expected a f",
        ),
        (
            '{"c": {"p": [0]}}',
            lambda v: v["c"]["p"].numbers(3),
            "s.json: c.p: expected a list of 3",
        ),
        ('{"c": [[1.5]]}', lambda v: v["c"].items()[0].integers(0), "s.json: c[0][0]: expected an"),
        (
            '{"c": -1}',
            lambda v: v["c"].integer(0, 4),
            "s.json: c: expected an integer of 0…4, got -1",
        ),
        (
            '{"c": 0}',
            lambda v: v["c"].number(above=0),
            "s.json: c: expected a finite number above 0",
        ),
        ('{"c": 0}', lambda v: v["d"], "s.json: no 'd'"),
        ('{"c": 0}', lambda v: v["c"]["d"], "s.json: c: expected an object with 'd', got 0"),
        ('{"c": 0}', lambda v: v["c"].text(), "s.json: c: expected a text, got 0"),
        ('{"c": 0}', lambda v: v["c"].flag(), "s.json: c: expected true or false, got 0"),
        ('{"c": "z"}', lambda v: v["c"].choice(("x", "y")), "s.json: c: expected one of x, y"),
        ('{"c": 0}', lambda v: v["c"].entries(), "s.json: c: expected an object"),
        ('{"c": 0}', lambda v: v.check_keys(("c", "d")), "s.json: no 'd'"),
        ('{"c": 0}', lambda v: v.check_keys((), ("d",)), "s.json: unknown key 'c'"),
        ('{"c": "' + "x" * 500 + '"}', lambda v: v["c"].items(), "xxx"),
    ],
)
def test_messages_name_file_and_path(text, check, words):
    with pytest.raises(InputError) as caught:
        check(value(text))
    assert words in str(caught.value) and len(str(caught.value)) < 200


def test_values_are_returned_as_they_are():
    data = value('{"n": [1, 2.5], "i": [3], "f": false, "t": "é", "o": {"k": null}}')
    assert data["n"].numbers(2) == (1.0, 2.5) and data["i"].integers() == [3]
    assert data["f"].flag() is False and data["t"].text() == "é"
    assert [(key, entry.value) for key, entry in data["o"].entries()] == [("k", None)]
    assert "o" in data and "x" not in data and "x" not in data["n"]
