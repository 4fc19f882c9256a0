"""What others wrote is read as its type, or refused with the place, what stands there and what should."""

import subprocess
import sys

import msgspec
import pytest

from flatcloth.core.decoding import Finite, MisfitError, Vector3, decoded, parse_json


class Part(msgspec.Struct, frozen=True):
    size_m: Finite
    at: Vector3 | None = None
    count: int = 0


class Whole(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    parts: tuple[Part, ...]
    name: str = ""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"parts": 1}', "parts is a number; expected a list"),
        ('{"parts": {}}', "parts is an object; expected a list"),
        ("[]", "it is a list of 0; expected an object"),
        ("{}", "parts is missing"),
        ('{"parts": [], "nom": 1}', "nom is no field that is known"),
        ('{"parts": [{}]}', "parts[0].size_m is missing"),
        ('{"parts": [{"size_m": null}]}', "parts[0].size_m is missing; expected a number"),
        ('{"parts": [{"size_m": 1}, {"size_m": "2"}]}', "parts[1].size_m is text; expected a number"),
        ('{"parts": [{"size_m": NaN}]}', "parts[0].size_m is not a finite number"),
        ('{"parts": [{"size_m": 1e999}]}', "parts[0].size_m is not a finite number"),
        ('{"parts": [{"size_m": 1' + "0" * 400 + "}]}", "parts[0].size_m is not a finite number"),
        (
            '{"parts": [{"size_m": "\\ud800"}]}',
            "parts[0].size_m is text with half a character; expected text",
        ),
        ('{"parts": [{"\\ud800": 1}]}', "parts[0] is text with half a character; expected text"),
        ('{"parts": [{"size_m": true}]}', "parts[0].size_m is true or false"),
        (
            '{"parts": [{"size_m": 1, "at": [1, 2]}]}',
            "parts[0].at is a list of 2; expected a list of length 3",
        ),
        ('{"parts": [{"size_m": 1, "count": 1.5}]}', "parts[0].count is a number; expected a whole number"),
    ],
)
def test_what_does_not_fit_is_named(text: str, said: str) -> None:
    with pytest.raises(MisfitError) as caught:
        decoded(text, Whole)
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"a": 1' + "0" * 5000 + "}"])
def test_what_is_no_json_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        parse_json(text)


_FIRST_USES = """
import sys, threading
import msgspec
from flatcloth.core.decoding import fitted

sys.setswitchinterval(1e-6)
for n in range(20):
    inner = msgspec.defstruct(f"Inner{n}", [("a", float), ("place", tuple[float, float])])
    middle = msgspec.defstruct(f"Middle{n}", [("one", inner | None), ("many", list[inner])])
    kind = msgspec.defstruct(f"Outer{n}", [("parts", list[middle]), ("named", dict[str, middle])])
    part = {"one": None, "many": [{"a": 1.0, "place": [2.0, 3.0]}]}
    ready, found = threading.Barrier(6), []

    def use(kind=kind, ready=ready, found=found):
        ready.wait()
        found.append(fitted({"parts": [part], "named": {"x": part}}, kind))

    threads = [threading.Thread(target=use) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 6
print("all were read")
"""


def test_a_type_may_be_used_first_on_several_threads_at_once() -> None:
    done = subprocess.run([sys.executable, "-c", _FIRST_USES], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "all were read\n"), done.stderr
