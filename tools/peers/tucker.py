#!/usr/bin/python3
"""Tucker decomposition of a raw BTF by weft and by TensorLy's partial_tucker, in turn, on the same data.

TensorLy is not in Debian: pip install tensorly (with numpy). Both with two threads:

  env -u OPENBLAS_CORETYPE OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=2 \
    /usr/bin/python3 tools/peers/tucker.py WEFT cloth.safetensors [V_RANK L_RANK [ROUNDS]]

TensorTextures: texels and channels whole, views and lights cut (default 61 and 27), by HOSVD, for which
TensorLy stops after its initialisation. weft's time is that of its encoder from the file (scan, norm, Gram
matrices, projection); TensorLy's that of partial_tucker on the float32 tensor in memory, its reading and
conversion left out. Then all images from the same factors: weft's decoder as `weft verify` runs it is not
timed here; NumPy's einsum with an optimised path is, as a bound for others.
"""
import json
import struct
import subprocess
import sys
import time

import numpy
from tensorly.decomposition import partial_tucker


def tensor(path):
    """views x lights x texels, float32."""
    with open(path, "rb") as file:
        (length,) = struct.unpack("<Q", file.read(8))
        entry = json.loads(file.read(length))["btf"]
    kinds = {"F16": numpy.float16, "F32": numpy.float32}
    values = numpy.memmap(path, dtype=kinds[entry["dtype"]], mode="r",
                          offset=8 + length + entry["data_offsets"][0], shape=tuple(entry["shape"]))
    v, l = values.shape[:2]
    return values.reshape(v, l, -1).astype(numpy.float32)


def main():
    weft, path = sys.argv[1:3]
    ranks = [int(a) for a in sys.argv[3:5]] if len(sys.argv) > 4 else [61, 27]
    rounds = int(sys.argv[5]) if len(sys.argv) > 5 else 2
    data = tensor(path)
    norm = float(numpy.linalg.norm(data))
    times = {"weft": [], "TensorLy": [], "einsum": []}
    errors = {}
    for _ in range(rounds):
        output = subprocess.run(
            [weft, "compress", path, "--codec", "tucker", "--merge", "yxc", "--ranks",
             f"v={ranks[0]},l={ranks[1]}", "--storage", "f32", "--memory", "8GiB", "--quiet", "--json",
             "-o", "/dev/shm/peer.weft"], check=True, capture_output=True).stdout
        report = json.loads(output)
        times["weft"].append(report["encode_time"])
        errors["weft"] = report["errors"]["relative"]
        start = time.monotonic()
        (core, factors), _ = partial_tucker(data, rank=ranks, modes=[0, 1], n_iter_max=1, init="svd")
        times["TensorLy"].append(time.monotonic() - start)
        kept = float(numpy.linalg.norm(core))
        errors["TensorLy"] = (max(norm ** 2 - kept ** 2, 0)) ** 0.5 / norm
        start = time.monotonic()
        image_sum = 0.0
        for view in factors[0]:  # one view at a time: all images would be as large as the data
            images = numpy.einsum("abp,a,lb->lp", core, view, factors[1], optimize="optimal")
            image_sum += float(images[0, 0])
        times["einsum"].append(time.monotonic() - start)
    for name in ("weft", "TensorLy"):
        print(f"{name:9} least {min(times[name]):.2f} s, error {errors[name]:.5f}")
    print(f"time ratio, TensorLy / weft: {min(times['TensorLy']) / min(times['weft']):.2f}")
    print(f"einsum of all {data.shape[0] * data.shape[1]} images: {min(times['einsum']):.2f} s")


if __name__ == "__main__":
    main()
