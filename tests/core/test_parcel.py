"""The container of JSON and arrays: what goes in comes out."""

import io

import numpy as np
import pytest

from flatcloth.core.parcel import LENGTHS, Arrays, Parcel, record, unpack

ARRAYS: Arrays = {
    "floats": np.array([[0.5, np.nan, -1.0]], dtype=np.float32),
    "none": np.zeros((0, 3), dtype=np.int16),
    "flags": np.array([True, False, True]),
    "big": np.arange(4, dtype=">u2").reshape(2, 2).T,
    "one": np.array(2.5),
}


def test_values_arrays_and_pictures_come_back() -> None:
    parcel = Parcel({"name": "hem"}, ARRAYS)
    parcel.picture("png", b"PNG", (1, 2))
    data = parcel.pack({"more": [1, None]})
    values, arrays = unpack(io.BytesIO(data).read)
    assert values == {"name": "hem", "more": [1, None]}
    assert arrays.pop("png").tobytes() == b"PNG"
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], array)
        assert arrays[name].dtype == array.dtype.newbyteorder("=")


def test_arrays_begin_where_a_browsers_arrays_may() -> None:
    parcel = Parcel(arrays={"a": np.ones(3, np.uint8), "b": np.ones(2)})
    data = parcel.pack()
    text, body = LENGTHS.unpack_from(data)
    assert len(data) == LENGTHS.size + text + body
    assert data[LENGTHS.size + text + 8 :] == np.ones(2).tobytes()


def test_numbers_that_a_page_cannot_read_are_refused_unless_allowed() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        record({"x": np.nan})
    values, _ = unpack(io.BytesIO(Parcel({"x": np.inf}).pack(allow_nan=True)).read)
    assert values == {"x": np.inf}
