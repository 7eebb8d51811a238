"""Reads files of ours without Weft: the rules of the public safetensors format, and the values.

    check_safetensors.py WRITE_SAMPLE_FILES

Only json, struct and numpy are used. The values are those of write_sample_files.cpp.
"""
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

import numpy

DTYPES = {"U8": "<u1", "U16": "<u2", "U32": "<u4", "F16": "<f2", "F32": "<f4", "F64": "<f8"}
V, L, Y, X, C = SHAPE = (2, 3, 4, 5, 3)


def no_duplicates(pairs):
    keys = [key for key, _ in pairs]
    assert len(keys) == len(set(keys)), f"duplicate keys in {keys}"
    return dict(pairs)


def read_safetensors(path):
    """Tensors by name and the metadata; asserts whatever the format demands of a writer."""
    data = path.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    assert 2 <= length <= 100_000_000 and 8 + length <= len(data), length
    text = data[8 : 8 + length]
    assert text.startswith(b"{"), text[:1]
    assert text.rstrip(b" ").endswith(b"}"), "padded with something other than spaces"
    header = json.loads(text.decode("utf-8"), object_pairs_hook=no_duplicates)
    metadata = header.pop("__metadata__")
    assert all(isinstance(value, str) for value in metadata.values()), metadata

    assert (8 + length) % 64 == 0, "data does not begin at a multiple of 64"
    tensors, end, last_size = {}, 0, 8
    for name, entry in header.items():  # in the order of the header, which is that of the data
        assert set(entry) == {"dtype", "shape", "data_offsets"}, entry
        dtype = numpy.dtype(DTYPES[entry["dtype"]])
        begin, stop = entry["data_offsets"]
        assert begin == end, f"{name} begins at {begin}, not {end}"
        size = dtype.itemsize * int(numpy.prod(entry["shape"], dtype=object))
        assert stop - begin == size, f"{name}: {stop - begin} bytes for {entry}"
        assert dtype.itemsize <= last_size, f"{name} breaks the order of element sizes"
        last_size = dtype.itemsize
        assert (8 + length + begin) % dtype.itemsize == 0, f"{name} is misaligned"
        values = numpy.frombuffer(data, dtype, size // dtype.itemsize, 8 + length + begin)
        tensors[name] = values.reshape(entry["shape"])
        end = stop
    assert 8 + length + end == len(data), "the last tensor does not end the file"
    return tensors, metadata


def expected_raw(dtype):
    i = numpy.arange(V * L * Y * X * C)
    values = {
        "U8": (7 * i % 256).astype("<u1"),
        "F16": ((i % 1024) / 8 - 3).astype("<f2"),
        "F32": (i / 3 - 20).astype("<f4"),
    }[dtype]
    return values.reshape(SHAPE)


def expected_mask():
    mask = numpy.ones(V * Y * X, "u1")
    mask[::7] = 0
    return mask.reshape(V, Y, X)


def check_directions(directions, count):
    assert directions.shape == (count, 3) and directions.dtype == numpy.dtype("<f4")
    assert numpy.allclose(numpy.linalg.norm(directions.astype(float), axis=1), 1, atol=1e-6)
    assert (directions[:, 2] > 0).all()


def check_side(tensors, metadata):
    """What raw files and models have in common."""
    check_directions(tensors["view_directions"], V)
    check_directions(tensors["light_directions"], L)
    assert (tensors["mask"] == expected_mask()).all()
    assert json.loads(metadata["channel_names"]) == ["R", "G", "B"]
    wanted = {"encoding": "srgb", "quantity": "radiance", "layout": "grid",
              "source": 'a "sample"', "weft.format": "1"}
    assert {key: metadata[key] for key in wanted} == wanted, metadata
    assert metadata["weft.version"].count(".") == 2


def check_raw(folder, dtype):
    tensors, metadata = read_safetensors(folder / f"raw_{dtype.lower()}.safetensors")
    assert set(tensors) == {"btf", "view_directions", "light_directions", "mask"}
    assert metadata["modes"] == "v,l,y,x,c"
    check_side(tensors, metadata)
    btf = tensors["btf"]
    assert btf.dtype == numpy.dtype(DTYPES[dtype]) and btf.shape == SHAPE
    assert btf.tobytes() == expected_raw(dtype).tobytes()


def check_npy(folder):
    values = numpy.load(folder / "raw_f16.npy", allow_pickle=False)
    assert values.dtype == numpy.dtype("<f2") and values.tobytes() == expected_raw("F16").tobytes()
    description = json.loads((folder / "raw_f16.json").read_text(encoding="utf-8"))
    for key, count in (("views", V), ("lights", L)):
        check_directions(numpy.array([d["dir"] for d in description[key]], "<f4"), count)
    runs = description["mask_runs"]
    mask = numpy.repeat(numpy.arange(len(runs)) % 2, runs)
    assert (mask == expected_mask().ravel()).all()


def model_values(count, first):
    return ((37 * (numpy.arange(count) + first) % 101) - 50) / 64


def check_model(folder, storage):
    tensors, metadata = read_safetensors(folder / f"model_{storage}.weft")
    check_side(tensors, metadata)
    assert metadata["codec"] == "pca" and metadata["storage"] == storage
    assert json.loads(metadata["parameters"]) == {"rank": 3}
    assert json.loads(metadata["selection"]) == {}
    assert json.loads(metadata["shape"]) == list(SHAPE) and metadata["dtype"] == "F16"
    checksums = json.loads(metadata["checksums"])
    assert set(checksums) == set(tensors)
    assert all(len(c) == 16 and set(c) <= set("0123456789abcdef") for c in checksums.values())

    k, row = 3, V * L * C
    powers = 2.0 ** (100 - 110 * numpy.arange(k))
    expected = {
        "mean": (model_values(row, 0).reshape(V, L, C), None),
        "coefficients": (model_values(Y * X * k, 1).reshape(Y * X, k), 1),
        "basis": (numpy.outer(powers, model_values(row, 2)).reshape(k, V, L, C), 0),
    }
    for name, (wanted, axis) in expected.items():
        values = tensors[name].astype(float)
        if storage == "f32":
            assert tensors[name].dtype == numpy.dtype("<f4")
        else:
            assert tensors[name].dtype == numpy.dtype("<f2")
            scale = tensors[f"{name}.scale"].astype(float)
            assert (numpy.frexp(scale)[0] == 0.5).all() and (scale > 0).all()
            assert scale.shape == ((1,) if axis is None else (wanted.shape[axis],))
            other_axes = None if axis is None else tuple(set(range(wanted.ndim)) - {axis})
            largest = numpy.abs(values).max(axis=other_axes)
            # Below 2^14 only where the scale is the smallest one.
            assert ((largest >= 2**14) | (scale == 2.0**-126)).all() and (largest < 2**15).all()
            broadcast = [1] * wanted.ndim
            if axis is not None:
                broadcast[axis] = -1
            values = values * scale.reshape(broadcast)
        assert values.shape == wanted.shape and (values == wanted).all(), name


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        subprocess.run([sys.argv[1], name], check=True)
        for dtype in ("U8", "F16", "F32"):
            check_raw(folder, dtype)
        check_npy(folder)
        for storage in ("f16", "f32"):
            check_model(folder, storage)
    print("six files checked")


if __name__ == "__main__":
    main()
