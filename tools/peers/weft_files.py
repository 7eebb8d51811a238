"""Raw BTFs and models of weft as NumPy arrays: both are safetensors files (no package is needed)."""
import json
import struct
import subprocess

import numpy

KINDS = {"U8": numpy.uint8, "F16": numpy.float16, "F32": numpy.float32}


def _tensors(path):
    """name -> array of all tensors, not yet read."""
    with open(path, "rb") as file:
        (length,) = struct.unpack("<Q", file.read(8))
        header = json.loads(file.read(length))
    return {name: numpy.memmap(path, dtype=KINDS[entry["dtype"]], mode="r", shape=tuple(entry["shape"]),
                               offset=8 + length + entry["data_offsets"][0])
            for name, entry in header.items() if name != "__metadata__" and entry["dtype"] in KINDS}


def raw_values(path):
    """views x lights x rows x columns x channels, float32; 8-bit values in [0, 1]."""
    values = _tensors(path)["btf"]
    if values.dtype == numpy.uint8:
        return values.astype(numpy.float32) / numpy.float32(255)
    return values.astype(numpy.float32)


def model_values(path, axes):
    """Tensors of a model, float32; axes(name): the one that a half tensor's scales go with."""
    tensors = _tensors(path)
    values = {}
    for name, array in tensors.items():
        if name.endswith(".scale") or array.dtype == numpy.uint8:
            continue
        values[name] = array.astype(numpy.float32)
        scale = tensors.get(name + ".scale")
        if scale is not None:
            shape = [1] * array.ndim
            shape[axes(name)] = -1
            values[name] *= numpy.asarray(scale).reshape(shape)
    return values


def run(weft, *arguments):
    """The report of one run."""
    output = subprocess.run([weft, *arguments, "--quiet", "--json"], check=True, capture_output=True).stdout
    return json.loads(output)


def print_times(times, of):
    """Least and median seconds of each, and how many times as long as `of` they took."""
    for name, seconds in times.items():
        ratios = sorted(s / o for s, o in zip(seconds, times[of]))
        print(f"  {name:34} least {min(seconds):7.3f} s, median {numpy.median(seconds):7.3f} s"
              + ("" if name == of else f", {min(seconds) / min(times[of]):.2f} times {of}'s"
                 f" (rounds: {', '.join(f'{r:.2f}' for r in ratios)})"))
