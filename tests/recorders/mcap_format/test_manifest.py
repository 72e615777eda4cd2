import getpass
import json
import platform
from itertools import pairwise

import pytest

from recorders.errors import LogError
from recorders.mcap_format.manifest import FORMAT_VERSION, content_sha256, environment, from_metadata, to_metadata
from recorders.messages.record import RecordedMessage


def test_values_come_back_and_are_json_strings():
    manifest = {"format_version": FORMAT_VERSION, "robot": "asimo", "rates": [0.1, 0.2], "nested": {"a": None}}
    metadata = to_metadata(manifest)
    assert from_metadata(metadata) == manifest
    assert json.loads(metadata["rates"]) == [0.1, 0.2]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object(), b"bytes"])
def test_what_is_not_json_is_refused_by_name(value):
    with pytest.raises(LogError, match="manifest: rate cannot be written as JSON"):
        to_metadata({"rate": value})


def test_keys_must_be_strings():
    with pytest.raises(LogError, match="keys that are strings, found 1"):
        to_metadata({1: 2})  # type: ignore[dict-item]


def test_a_changed_value_is_found_out():
    metadata = to_metadata({"format_version": 1, "seed": 3})
    for changed in ({**metadata, "seed": "4"}, {**metadata, "more": "4"}, {"seed": "3"}):
        with pytest.raises(LogError, match="checksum"):
            from_metadata(changed)


@pytest.mark.parametrize(
    ("version", "found"),
    [(FORMAT_VERSION + 1, "3"), (0, "0"), (True, "true"), (1.0, "1.0"), ("1", "'1'"), (None, "nothing")],
)
def test_a_format_that_is_not_known_is_refused(version, found):
    expected = f"expected log format {FORMAT_VERSION} or older, found {found}: it needs a newer reenact"
    with pytest.raises(LogError, match=expected):
        from_metadata(to_metadata({"format_version": version}))


def test_the_environment_names_no_user_host_or_path():
    found = environment()
    assert found == environment()
    assert found.keys() == {"python", "implementation", "system", "machine", "cpu", "packages"}
    assert {"numpy", "mcap", "reenact"} <= found["packages"].keys()
    named = {found[key] for key in found if key != "packages"}
    assert not named & {platform.node(), getpass.getuser()}
    assert not any(str(value).startswith("/") for value in named)


def test_the_content_hash_tells_every_field_apart():
    base = RecordedMessage("/a", "t", b"bc", 1, 2)
    variants = [
        [base],
        [base._replace(topic="/ab", data=b"c")],
        [base._replace(sequence=2, log_time_ns=1)],
        [base._replace(data=b"bd")],
        [base, base],
        [],
    ]
    hashes = sorted(content_sha256(records) for records in variants)
    assert all(first != second for first, second in pairwise(hashes))
