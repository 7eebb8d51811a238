#!/usr/bin/python3
"""Rank-k truncation of a raw BTF by weft and by scikit-learn's randomized_svd, in turn, on the same data.

Debian: apt-get install python3-sklearn. Both with two threads:

  env -u OPENBLAS_CORETYPE OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=2 \
    /usr/bin/python3 tools/peers/randomized_svd.py WEFT cloth.safetensors [RANK [ITERATIONS [ROUNDS]]]

weft's time is that of its encoder from the file (scan, products, bases); scikit-learn's that of
randomized_svd on the mean-removed float32 matrix in memory, its reading and conversion left out. The
error of both is |A - A_k| / |A| from the singular values that they give.
"""
import json
import struct
import subprocess
import sys
import time

import numpy
from sklearn.utils.extmath import randomized_svd


def centred_matrix(path):
    """texels x (view, light, channel), its mean removed, float32."""
    with open(path, "rb") as file:
        (length,) = struct.unpack("<Q", file.read(8))
        entry = json.loads(file.read(length))["btf"]
    kinds = {"F16": numpy.float16, "F32": numpy.float32}
    values = numpy.memmap(path, dtype=kinds[entry["dtype"]], mode="r",
                          offset=8 + length + entry["data_offsets"][0], shape=tuple(entry["shape"]))
    v, l, y, x, c = values.shape
    matrix = numpy.empty((v * l, c, y * x), dtype=numpy.float32)
    flat = values.reshape(v * l, y * x, c)
    for image in range(v * l):
        matrix[image] = flat[image].T
    matrix = matrix.reshape(v * l * c, y * x)
    matrix -= matrix.mean(axis=1, dtype=numpy.float64).astype(numpy.float32)[:, None]
    return matrix.T


def main():
    weft, path = sys.argv[1:3]
    rank = int(sys.argv[3]) if len(sys.argv) > 3 else 64
    iterations = int(sys.argv[4]) if len(sys.argv) > 4 else 4
    rounds = int(sys.argv[5]) if len(sys.argv) > 5 else 3
    matrix = centred_matrix(path)
    squares = sum(float(numpy.dot(row, row)) for row in matrix.T)
    times = {"weft": [], "scikit-learn": []}
    errors = {}
    for _ in range(rounds):
        output = subprocess.run(
            [weft, "compress", path, "--svd", "randomized", "--rank", str(rank), "--storage", "f32",
             "--quiet", "--json", "-o", "/dev/shm/peer.weft"], check=True, capture_output=True).stdout
        report = json.loads(output)
        times["weft"].append(report["encode_time"])
        # relative to T with its mean: |T|^2 = |A|^2 + P |mean|^2
        snr = report["errors"]["rmse"] ** 2 * matrix.size
        errors["weft"] = (snr / squares) ** 0.5
        start = time.monotonic()
        sigma = randomized_svd(matrix, rank, n_oversamples=8, n_iter=iterations, random_state=0)[1]
        times["scikit-learn"].append(time.monotonic() - start)
        kept = float(numpy.sum(sigma.astype(numpy.float64) ** 2))
        errors["scikit-learn"] = (max(squares - kept, 0) / squares) ** 0.5
    for name in times:
        print(f"{name:13} least {min(times[name]):.2f} s, error {errors[name]:.5f}")
    print(f"time ratio, scikit-learn / weft: {min(times['scikit-learn']) / min(times['weft']):.2f}")


if __name__ == "__main__":
    main()
